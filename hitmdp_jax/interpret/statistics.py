"""What a few seeds tell: robust means, comparisons and their intervals.

Source: Agarwal et al. 2021, "Deep RL at the edge of the statistical precipice".
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

BOOTSTRAPS = 10_000
CONFIDENCE = 0.95
FEWEST = 5  # scores of which an interval is told: that of two is their range, and no 95%
SMALL = 20.0  # returns below it, of Reacher say, differ in their second digit after the point


def interquartile_mean(*strata: ArrayLike, axis: int = -1) -> Any:
    """Return the mean of the middle half of all scores, those of every stratum pooled.

    A quarter of the scores, rounded down, is cut off at each end: of fewer than four nothing is,
    and the interquartile mean is the mean. A score of NaN makes it NaN.

    Args:
      *strata: the scores, [..., S] each: one array a task, say.
      axis: that of the scores.
    """
    return stats.trim_mean(np.concatenate(strata, axis=axis), 0.25, axis=axis)


def probability_of_improvement(x: ArrayLike, y: ArrayLike, axis: int = -1) -> Any:
    """Return the share of pairs in which x beats y; a tie counts half, NaN makes it NaN.

    Args:
      x: the scores of one algorithm, [..., S].
      y: those of the other, [..., S'].
      axis: that of the scores.
    """
    x, y = np.moveaxis(np.asarray(x), axis, -1), np.moveaxis(np.asarray(y), axis, -1)
    return (0.5 + 0.5 * np.sign(x[..., :, None] - y[..., None, :])).mean(axis=(-2, -1))


def mean_improvement(*pairs: ArrayLike, axis: int = -1) -> Any:
    """Return the probability of improvement, averaged over tasks.

    Args:
      *pairs: of each task the scores of one algorithm [..., S], then those of the other [..., S'].
      axis: that of the scores.
    """
    tasks = zip(pairs[::2], pairs[1::2], strict=True)
    return np.mean([probability_of_improvement(x, y, axis) for x, y in tasks], axis=0)


def difference(x: ArrayLike, y: ArrayLike, axis: int = -1) -> Any:
    """Return the interquartile mean of x [..., S] minus that of y [..., S']."""
    return interquartile_mean(x, axis=axis) - interquartile_mean(y, axis=axis)


def bootstrap_interval(
    statistic: Callable[..., Any], *strata: ArrayLike, arms: int | None = None
) -> tuple[float, float]:
    """Return the 95% percentile interval of a statistic, each stratum resampled by itself.

    The resamples are drawn from a fixed seed, so that a table of the same runs is the same table.

    Args:
      statistic: of arrays [..., S] along their `axis`, as the two above.
      *strata: the scores, [S] each, that are its arguments.
      arms: of how many arms they are, in turn, one task after the other; None: each of another.

    Returns:
      The interval's ends; NaN where an arm has fewer than `FEWEST` scores on all tasks together, or
      a single one on a task, or a score of NaN.
    """
    samples = [np.asarray(x, float) for x in strata]
    arms = arms or len(samples)
    few = any(sum(map(len, samples[i::arms])) < FEWEST for i in range(arms))
    if few or any(len(x) < 2 or np.isnan(x).any() for x in samples):
        return math.nan, math.nan
    interval = stats.bootstrap(
        samples,
        statistic,
        n_resamples=BOOTSTRAPS,
        vectorized=True,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(interval.low), float(interval.high)


def rounding(*strata: ArrayLike, fewer: int = 0) -> str:
    """Return the format by which tables show returns: to a tenth, small ones to a hundredth.

    Args:
      *strata: all the returns of a table.
      fewer: digits less, where every seed's is shown.
    """
    small = np.nanmax(np.abs(np.concatenate(strata)), initial=0.0) < SMALL
    return f".{(2 if small else 1) - fewer}f"


def number_text(x: float, spec: str = ".1f") -> str:
    """Return a number as a table shows it: "-" where it is not known (NaN), and no -0.00."""
    if math.isnan(x):
        return "-"
    shown = format(x, spec)
    return shown.lstrip("-") if float(shown) == 0 else shown


def with_interval(
    statistic: Callable[..., Any],
    *strata: ArrayLike,
    spec: str = ".1f",
    arms: int | None = None,
) -> str:
    """Return a statistic with its 95% interval as a table shows it: `12.0 [10.1, 13.9]`.

    Where there is no interval, of few scores, the statistic stands alone.

    Args and intervals are those of `bootstrap_interval`; `spec` is `number_text`'s.
    """
    ends = bootstrap_interval(statistic, *strata, arms=arms)
    middle, low, high = (number_text(x, spec) for x in (float(statistic(*strata)), *ends))
    return middle if math.isnan(ends[0]) else f"{middle} [{low}, {high}]"


def against(x: np.ndarray, control: np.ndarray, spec: str = ".1f") -> list[str]:
    """Return how scores compare with a control's, as two fields of a table.

    Args:
      x: the scores [S].
      control: the control's [S'].
      spec: of the difference; `number_text`'s.

    Returns:
      The difference with its interval, and the probability of improvement; of the control itself,
      nothing.
    """
    if x is control:
        return ["", ""]
    better = float(probability_of_improvement(x, control))
    return [with_interval(difference, x, control, spec=spec), number_text(better, ".2f")]
