"""What the seeds of a run return at its end, in numbers and in words."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from hitmdp_jax.interpret.statistics import FEWEST, interquartile_mean, rounding, with_interval
from hitmdp_jax.learning.options import mean_duration
from hitmdp_jax.runs.metrics import Metrics

INTERVAL = "95% interval"
FINAL_STEPS = 100_000  # environment steps whose episodes make up a final return
LIKE = 0.95  # of the longest run's steps: with fewer a run is shorter than others
USED = 0.05  # of the steps: an option with fewer is not counted as used


def final_reports(metrics: Metrics, switch_at: int | None) -> np.ndarray:
    """Return which reports [n] count at a run's end: those of the last `FINAL_STEPS` of its task.

    Args:
      metrics: as `read_metrics` gives them.
      switch_at: environment steps after which a transfer's second task began; None of one task.
    """
    steps = metrics["env_steps"][0]
    return steps > max(steps[-1] - FINAL_STEPS, _beginning(int(steps[-1]), switch_at))


def final_window(env_steps: int, switch_at: int | None) -> str:
    """Return the steps of the final reports in words: "the last 100,000 steps".

    Args:
      env_steps: those of a seed in the whole run.
      switch_at: as `final_reports`.
    """
    beginning = _beginning(env_steps, switch_at)
    steps = env_steps - beginning
    if steps > FINAL_STEPS:
        return f"the last {FINAL_STEPS:,} steps"
    return f"all {steps:,} steps" + (" of the second task" if beginning else "")


def _beginning(env_steps: int, switch_at: int | None) -> int:
    """Return the environment steps before the task that a run is on."""
    return switch_at if switch_at is not None and env_steps > switch_at else 0


def one_window(windows: Iterable[str]) -> str:
    """Return the words for several runs' final windows."""
    first, *others = dict.fromkeys(windows)
    return f"the last {FINAL_STEPS:,} steps, or all of a shorter run" if others else first


def final_returns(
    metrics: Metrics, switch_at: int | None, of: str = "episode_return"
) -> np.ndarray:
    """Return each seed's mean return [S] over the episodes of the final reports.

    Their interquartile mean over seeds is a run's return wherever one number is told. A seed in
    which no episode ended has NaN.

    Args:
      metrics: as `read_metrics` gives them.
      switch_at: as `final_reports`.
      of: what is told of an episode, if not its return.
    """
    return mean_return(metrics, final_reports(metrics, switch_at), of)


def headline(metrics: Metrics, switch_at: int | None) -> tuple[str, str]:
    """Return the name of a run's return, and the number with its explanation.

    Args are those of `final_reports`, the metrics of the seeds of one setting.
    """
    returns = final_returns(metrics, switch_at)
    name = f"return of {final_window(int(metrics['env_steps'][0, -1]), switch_at)}"
    if np.isnan(returns).any():
        return name, "not known: a seed ended no episode in them"
    score = with_interval(interquartile_mean, returns, spec=rounding(returns))
    if len(returns) > 1:
        interval = f" with its {INTERVAL}" if len(returns) >= FEWEST else ""
        score += f" (interquartile mean of {len(returns)} seeds{interval})"
    return name, score


def median_speed(metrics: Metrics) -> float:
    """Return the steps of one seed per second, the median over a run; NaN where none is known."""
    speeds = metrics["steps_per_second"][0]
    known = speeds[np.isfinite(speeds)]
    return float(np.median(known)) if known.size else math.nan


def length_warning(env_steps: Mapping[str, int]) -> str | None:
    """Return a sentence where runs, name -> environment steps, are of unlike length."""
    if min(env_steps.values()) >= LIKE * max(env_steps.values()):
        return None
    told = ", ".join(f"{name} {steps:,}" for name, steps in env_steps.items())
    return f"The runs are of unlike length, and a longer one learned for longer: {told} steps."


def mean_return(metrics: Metrics, reports: np.ndarray, of: str = "episode_return") -> np.ndarray:
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


def last_episodes(metrics: Metrics, count: int, since: int = 0) -> np.ndarray:
    """Return each seed's mean return [R] over its last reports that hold `count` episodes.

    It is NaN for a seed that did not end as many.

    Args:
      metrics: as `read_metrics` gives them.
      count: episodes, at least: all those of a report count.
      since: environment steps before which no episode counts.
    """
    episodes = np.nan_to_num(metrics["episodes"]) * (metrics["env_steps"] > since)
    total = np.nan_to_num(metrics["episode_return"]) * episodes
    after = np.cumsum(episodes[:, ::-1], axis=1)[:, ::-1] - episodes  # those of later reports
    counted = np.where(after < count, episodes, 0.0)
    enough = counted.sum(axis=1) >= count
    mean = np.where(after < count, total, 0.0).sum(axis=1) / np.maximum(counted.sum(axis=1), 1.0)
    return np.where(enough, mean, np.nan)


def options_at_the_end(
    metrics: Metrics, switch_at: int | None
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return how many options each seed uses [S], and how many steps its main one lasts [S].

    None of an algorithm without options. Args are those of `final_reports`.
    """
    num_options = sum(name.startswith("option_steps_") for name in metrics)
    if not num_options:
        return None
    last = final_reports(metrics, switch_at)
    steps, activations = (
        np.stack([np.nansum(metrics[f"{name}_{k}"][:, last], axis=1) for k in range(num_options)])
        for name in ("option_steps", "option_activations")
    )
    main = steps.argmax(axis=0)[None]
    duration = np.take_along_axis(mean_duration(steps, activations), main, axis=0)[0]
    return (steps > USED * steps.sum(axis=0)).sum(axis=0).astype(float), duration


def failed(returns: np.ndarray) -> int:
    """Return how many seeds [S] end below half of their median, or below twice a negative one."""
    median = np.median(returns)
    return int((returns < median - 0.5 * abs(median)).sum())
