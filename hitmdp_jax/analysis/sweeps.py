"""What a sweep found: its settings, the best first, as a table and a figure."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.analysis import tables
from hitmdp_jax.analysis.colors import color
from hitmdp_jax.analysis.comparison import FINAL_STEPS, final_returns
from hitmdp_jax.analysis.figures import FAINT, draw_figures, plain, read_metrics, save
from hitmdp_jax.analysis.statistics import bootstrap_interval, interquartile_mean, number, rounding
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.folder import FIGURES, SWEEP
from hitmdp_jax.training.sweep import PREFIX, label


@dataclasses.dataclass(frozen=True)
class SettingResult:
    """What one setting of a sweep led to. Returns are undiscounted, of the training policy."""

    setting: int
    swept: dict[str, float]
    final_returns: np.ndarray  # [S] mean over the last FINAL_STEPS of each seed
    iqm: float  # interquartile mean over seeds
    low: float  # 95% bootstrap interval of it; NaN for a single seed
    high: float


def rank(metrics: Mapping[str, np.ndarray], config: RunConfig) -> list[SettingResult]:
    """Return a sweep's settings, the one with the highest interquartile mean first.

    Those in which a seed has no return come last.

    Args:
      metrics: as `read_metrics` gives them.
      config: the run's settings.
    """
    returns = final_returns(metrics, config.switch_at or 0).reshape(-1, config.seeds)
    results = []
    for setting, (swept, own) in enumerate(zip(config.settings, returns, strict=True)):
        low, high = bootstrap_interval(interquartile_mean, own)
        iqm = float(interquartile_mean(own))
        results.append(SettingResult(setting, swept, own, iqm, low, high))
    return sorted(results, key=lambda r: math.inf if math.isnan(r.iqm) else -r.iqm)


def draw_sweep(run_dir: Path, config: RunConfig) -> list[list[str]]:
    """Write `sweep.csv`, `sweep.md` and the figures of a sweep: all settings, and the best one.

    Returns:
      The table, as `table` gives it.
    """
    results = rank(read_metrics(run_dir), config)
    rows, best = table(results), results[0]
    tables.save(rows, run_dir, SWEEP)
    title, algorithm = f"{config.title}, {label(best.swept)}", config.algo["name"]
    draw_figures(run_dir, title, algorithm, config.switch_at, best.setting)
    drawn = sweep_figure(results, config.title, algorithm)
    save(drawn, run_dir / FIGURES / f"{SWEEP}.png")
    return rows


def table(results: Sequence[SettingResult]) -> list[list[str]]:
    """Return the settings as rows of text, the header first."""
    names = [name.removeprefix(PREFIX) for name in results[0].swept]
    rows = [["setting", *names, "IQM [95% interval]", "mean", "std", "per seed"]]
    every = [result.final_returns for result in results]
    spec, of_each = rounding(*every), rounding(*every, fewer=1)
    for result in results:
        returns = result.final_returns
        iqm, low, high = (number(x, spec) for x in (result.iqm, result.low, result.high))
        rows.append(
            [
                str(result.setting),
                *(f"{value:.4g}" for value in result.swept.values()),
                f"{iqm} [{low}, {high}]",
                number(returns.mean(), spec),
                number(returns.std(), spec),
                " ".join(number(x, of_each) for x in returns),
            ]
        )
    return rows


def sweep_figure(results: Sequence[SettingResult], title: str, algorithm: str) -> Figure:
    """Plot each setting's final returns: every seed a dot, the IQM with its interval, best on top.

    Args:
      results: as `rank` gives them.
      title: the figure's title.
      algorithm: whose colour it has, as settings name it.
    """
    figure = Figure(figsize=(7, 1.5 + 0.3 * len(results)), layout="constrained")
    axes = figure.subplots()
    look: Any = {"color": color(algorithm)}
    for place, result in enumerate(results):
        every = [place] * len(result.final_returns)
        axes.plot(result.final_returns, every, "o", ms=4, alpha=FAINT, mew=0, **look)
        axes.plot([result.low, result.high], [place, place], lw=2, **look)
        axes.plot([result.iqm], [place], "|", ms=12, mew=2, **look)
    axes.set_yticks(range(len(results)), [plain(label(result.swept)) for result in results])
    axes.invert_yaxis()
    axes.set(xlabel=f"return of the last {FINAL_STEPS:,} steps: IQM, 95% interval, each seed")
    axes.set_title(plain(title))
    axes.grid(alpha=0.3)
    return figure
