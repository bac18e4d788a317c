"""Several algorithms on one task: a table and a figure in the style of the paper's Figure 3."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.analysis.colors import styles
from hitmdp_jax.analysis.figures import draw_seeds, label_curves, read_metrics
from hitmdp_jax.analysis.statistics import bootstrap_interval, interquartile_mean, number, rounding

FINAL_STEPS = 100_000  # environment steps whose episodes make up a final return


@dataclasses.dataclass(frozen=True)
class Result:
    """What one algorithm did. Returns are undiscounted, of the training policy."""

    algo: str
    final_returns: np.ndarray  # [S] mean over the last FINAL_STEPS of each seed
    iqm: float  # interquartile mean over seeds
    iqm_low: float  # 95% bootstrap interval of it; NaN for a single seed
    iqm_high: float
    steps_per_second: float  # of all seeds together, median over the run
    parameters: int


def final_returns(
    metrics: Mapping[str, np.ndarray], since: int = 0, of: str = "episode_return"
) -> np.ndarray:
    """Return each seed's mean return [S] over episodes that ended in the last FINAL_STEPS.

    It is NaN for a seed in which none did.

    Args:
      metrics: as `read_metrics` gives them.
      since: environment steps before which no episode counts.
      of: what is told of an episode, if not its return.
    """
    steps = metrics["env_steps"][0]
    return mean_return(metrics, steps > max(steps[-1] - FINAL_STEPS, since), of)


def mean_return(
    metrics: Mapping[str, np.ndarray], reports: np.ndarray, of: str = "episode_return"
) -> np.ndarray:
    """Return each seed's mean return [S] over the episodes of some reports; NaN where none ended.

    Args:
      metrics: as `read_metrics` gives them.
      reports: which of them, as an index of NumPy's.
      of: what is told of an episode, if not its return.
    """
    returns, episodes = metrics[of][:, reports], metrics["episodes"][:, reports]
    count = np.nansum(episodes, axis=1)
    total = np.nansum(returns * episodes, axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def compare(
    run_dirs: Mapping[str, Path], parameters: Mapping[str, int], since: int = 0
) -> list[Result]:
    """Summarise finished runs, one for each algorithm.

    Args:
      run_dirs: algorithm -> its run's folder.
      parameters: algorithm -> number of parameters of one seed.
      since: environment steps before which no episode counts: those of a transfer's first task.
    """
    runs = {algo: read_metrics(folder) for algo, folder in run_dirs.items()}
    finals = {algo: final_returns(metrics, since) for algo, metrics in runs.items()}
    intervals = {algo: bootstrap_interval(interquartile_mean, x) for algo, x in finals.items()}
    return [
        Result(
            algo=algo,
            final_returns=finals[algo],
            iqm=float(interquartile_mean(finals[algo])),
            iqm_low=intervals[algo][0],
            iqm_high=intervals[algo][1],
            steps_per_second=float(
                np.median(metrics["steps_per_second"][0]) * len(metrics["steps_per_second"])
            ),
            parameters=parameters[algo],
        )
        for algo, metrics in runs.items()
    ]


def table(results: Sequence[Result]) -> list[list[str]]:
    """Return the comparison as rows of text, the header first."""
    rows = [["algo", "return", "std", "IQM [95% interval]", "per seed", "steps/s", "parameters"]]
    every = [result.final_returns for result in results]
    spec, of_each = rounding(*every), rounding(*every, fewer=1)
    for result in results:
        returns = result.final_returns
        iqm, low, high = (number(x, spec) for x in (result.iqm, result.iqm_low, result.iqm_high))
        rows.append(
            [
                result.algo,
                number(returns.mean(), spec),
                number(returns.std(), spec),
                f"{iqm} [{low}, {high}]",
                " ".join(number(x, of_each) for x in returns),
                f"{result.steps_per_second:.0f}",
                str(result.parameters),
            ]
        )
    return rows


def comparison_figure(
    run_dirs: Mapping[str, Path], title: str, switch_at: int | None = None
) -> Figure:
    """Plot every algorithm's learning curve: mean and spread of its seeds (Figures 3, 4).

    Args:
      run_dirs: algorithm -> its run's folder.
      title: the figure's title.
      switch_at: environment steps after which a transfer's second task began; it is marked.
    """
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots()
    looks = styles({algo: algo for algo in run_dirs})
    for algo, folder in run_dirs.items():
        draw_seeds(axes, read_metrics(folder), looks[algo], algo, switch_at)
    label_curves(axes, title, switch_at)
    axes.legend()
    return figure
