"""What a sweep found: its settings, the best first, as a table and a figure."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.experiments import tables
from hitmdp_jax.experiments.comparison import INTERVAL, columns, fields, final_returns, final_window
from hitmdp_jax.experiments.statistics import bootstrap_interval, interquartile_mean
from hitmdp_jax.figures.curves import FAINT, draw_figures, read_metrics, save
from hitmdp_jax.figures.style import color, plain
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import FIGURES, SWEEP
from hitmdp_jax.training.sweep import PREFIX, label


@dataclasses.dataclass(frozen=True)
class SettingResult:
    """What one setting of a sweep led to. Returns are undiscounted, of the training policy."""

    setting: int
    swept: dict[str, float]
    final_returns: np.ndarray  # [S] as the function of that name gives them
    window: str  # the steps that they are of, in words

    @property
    def iqm(self) -> float:
        """Their interquartile mean."""
        return float(interquartile_mean(self.final_returns))


def by_setting(
    config: RunConfig, columns: Mapping[str, np.ndarray]
) -> dict[str, dict[str, np.ndarray]]:
    """Return what is known of a run's trainings setting by setting: their seeds alone compare.

    Args:
      config: the run's settings.
      columns: arrays [R, ...] by name, of all trainings.

    Returns:
      What each setting is called, "" in a run that sweeps nothing -> its arrays [S, ...].
    """
    labels = [label(swept) for swept in config.settings]  # rounded: two may be the same
    names = [x if labels.count(x) == 1 else f"{x} (setting {i})" for i, x in enumerate(labels)]
    return {
        name: {column: x[i * config.seeds :][: config.seeds] for column, x in columns.items()}
        for i, name in enumerate(names)
    }


def rank(metrics: Mapping[str, np.ndarray], config: RunConfig) -> list[SettingResult]:
    """Return a sweep's settings, the one with the highest interquartile mean first.

    Those in which a seed has no return come last.

    Args:
      metrics: as `read_metrics` gives them.
      config: the run's settings.
    """
    window = final_window(metrics, config.switch_at)
    results = [
        SettingResult(i, config.settings[i], final_returns(own, config.switch_at), window)
        for i, own in enumerate(by_setting(config, metrics).values())
    ]
    return sorted(results, key=lambda r: math.inf if math.isnan(r.iqm) else -r.iqm)


def draw_sweep(run_dir: Path, config: RunConfig) -> list[list[str]]:
    """Write `sweep.csv`, `sweep.md` and the figures of a sweep: all settings, and the best one.

    Returns:
      The table, as `table` gives it.
    """
    results = rank(read_metrics(run_dir, len(config.trainings)), config)
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
    rows = [["setting", *names, *columns(results[0].window)]]
    every = [result.final_returns for result in results]
    for result in results:
        values = (f"{value:.4g}" for value in result.swept.values())
        rows.append([str(result.setting), *values, *fields(result.final_returns, every)])
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
        ends = bootstrap_interval(interquartile_mean, result.final_returns)
        axes.plot(ends, [place, place], lw=2, **look)
        axes.plot([result.iqm], [place], "|", ms=12, mew=2, **look)
    axes.set_yticks(range(len(results)), [plain(label(result.swept)) for result in results])
    axes.invert_yaxis()
    seeds = len(results[0].final_returns)
    axes.set_xlabel(f"return of {results[0].window}: each of {seeds} seeds, IQM, {INTERVAL}")
    axes.set_title(plain(title))
    axes.grid(alpha=0.3)
    return figure
