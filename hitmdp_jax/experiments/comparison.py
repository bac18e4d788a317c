"""Several algorithms on one task: a table and a figure in the style of the paper's Figure 3."""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.experiments.statistics import (
    FEWEST,
    interquartile_mean,
    number,
    rounding,
    with_interval,
)
from hitmdp_jax.figures.curves import draw_seeds, label_curves, read_metrics
from hitmdp_jax.figures.style import styles

INTERVAL = "95% interval"
FINAL_STEPS = 100_000  # environment steps whose episodes make up a final return
LIKE = 0.95  # of the longest run's steps: with fewer a run is shorter than others

Metrics = Mapping[str, np.ndarray]  # as `read_metrics` gives them


@dataclasses.dataclass(frozen=True)
class Result:
    """What one algorithm did. Returns are undiscounted, of the training policy."""

    algo: str
    final_returns: np.ndarray  # [S] as the function of that name gives them
    window: str  # the steps that they are of, in words
    env_steps: int  # of each seed
    steps_per_second: float  # of all seeds together, median over the run
    parameters: int


def final_reports(metrics: Metrics, switch_at: int | None) -> np.ndarray:
    """Return which reports [n] count at a run's end: those of the last `FINAL_STEPS` of its task.

    Args:
      metrics: as `read_metrics` gives them.
      switch_at: environment steps after which a transfer's second task began; None of one task.
    """
    steps = metrics["env_steps"][0]
    return steps > max(steps[-1] - FINAL_STEPS, _beginning(metrics, switch_at))


def final_window(metrics: Metrics, switch_at: int | None) -> str:
    """Return the steps of the final reports in words: "the last 100,000 steps".

    Args are those of `final_reports`.
    """
    beginning = _beginning(metrics, switch_at)
    steps = int(metrics["env_steps"][0, -1]) - beginning
    if steps > FINAL_STEPS:
        return f"the last {FINAL_STEPS:,} steps"
    return f"all {steps:,} steps" + (" of the second task" if beginning else "")


def _beginning(metrics: Metrics, switch_at: int | None) -> int:
    """Return the environment steps before the task that a run is on."""
    return switch_at if switch_at is not None and metrics["env_steps"][0, -1] > switch_at else 0


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
      switch_at: environment steps after which a transfer's second task began; None of one task.
      of: what is told of an episode, if not its return.
    """
    return mean_return(metrics, final_reports(metrics, switch_at), of)


def headline(metrics: Metrics, switch_at: int | None) -> tuple[str, str]:
    """Return what a run's return is called, and the number with what it stands for.

    Args are those of `final_reports`, the metrics of the seeds of one setting.
    """
    returns, name = (
        final_returns(metrics, switch_at),
        f"return of {final_window(metrics, switch_at)}",
    )
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


def compare(
    run_dirs: Mapping[str, Path], parameters: Mapping[str, int], switch_at: int | None = None
) -> list[Result]:
    """Summarise finished runs, one for each algorithm.

    Args:
      run_dirs: algorithm -> its run's folder.
      parameters: algorithm -> number of parameters of one seed.
      switch_at: environment steps after which a transfer's second task began; None of one task.
    """
    runs = {algo: read_metrics(folder) for algo, folder in run_dirs.items()}
    return [
        Result(
            algo=algo,
            final_returns=final_returns(metrics, switch_at),
            window=final_window(metrics, switch_at),
            env_steps=int(metrics["env_steps"].max()),
            steps_per_second=median_speed(metrics) * len(metrics["steps_per_second"]),
            parameters=parameters[algo],
        )
        for algo, metrics in runs.items()
    ]


def table(results: Sequence[Result]) -> list[list[str]]:
    """Return the comparison as rows of text, the header first."""
    window = one_window(result.window for result in results)
    rows = [["algo", *columns(window), "steps/s", "parameters"]]
    every = [result.final_returns for result in results]
    for result in results:
        speed = number(result.steps_per_second, ".0f")
        told = fields(result.final_returns, every)
        rows.append([result.algo, *told, speed, str(result.parameters)])
    return rows


def columns(window: str) -> list[str]:
    """Return the names of a table's columns that tell of returns, of the steps of those words."""
    return ["seeds", f"IQM of {window} [{INTERVAL}]", "mean", "std", "per seed"]


def fields(returns: np.ndarray, every: Sequence[np.ndarray]) -> list[str]:
    """Return what stands in the columns of that name, of the seeds' returns [S].

    Args:
      returns: those of the row.
      every: those of all rows.
    """
    spec, of_each = rounding(*every), rounding(*every, fewer=1)
    return [
        str(len(returns)),
        with_interval(interquartile_mean, returns, spec=spec),
        number(returns.mean(), spec),
        number(returns.std(), spec),
        " ".join(number(x, of_each) for x in returns),
    ]


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
