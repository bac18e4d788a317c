"""What a sweep found: its settings, the best first, as a table and a figure."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from hitmdp_jax.experiments import tables
from hitmdp_jax.figures.curves import FAINT, draw_figures, save
from hitmdp_jax.figures.style import color, plain
from hitmdp_jax.interpret.comparison import sweep_table
from hitmdp_jax.interpret.returns import INTERVAL
from hitmdp_jax.interpret.statistics import bootstrap_interval, interquartile_mean
from hitmdp_jax.interpret.summary import Summary, rank
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import FIGURES, SWEEP
from hitmdp_jax.runs.metrics import read_metrics
from hitmdp_jax.training.sweep import label


def draw_sweep(run_dir: Path, config: RunConfig) -> list[list[str]]:
    """Write `sweep.csv`, `sweep.md` and the figures of a sweep: all settings, and the best one.

    Returns:
      The table, as `table` gives it.
    """
    settings = rank(config, read_metrics(run_dir, len(config.trainings)))
    rows, best = sweep_table(settings), next(iter(settings.values())).setting
    tables.save(rows, run_dir, SWEEP)
    title, algorithm = f"{config.title}, {label(config.settings[best])}", config.algo["name"]
    draw_figures(run_dir, title, algorithm, config.switch_at, best)
    drawn = sweep_figure(settings, config.title, algorithm)
    save(drawn, run_dir / FIGURES / f"{SWEEP}.png")
    return rows


def sweep_figure(settings: Mapping[str, Summary], title: str, algorithm: str) -> Figure:
    """Plot each setting's final returns: every seed a dot, the IQM with its interval, best on top.

    Args:
      settings: as `rank` gives them.
      title: the figure's title.
      algorithm: whose colour it has, as settings name it.
    """
    figure = Figure(figsize=(7, 1.5 + 0.3 * len(settings)), layout="constrained")
    axes = figure.subplots()
    look: Any = {"color": color(algorithm)}
    for place, run in enumerate(settings.values()):
        axes.plot(run.returns, [place] * len(run.returns), "o", ms=4, alpha=FAINT, mew=0, **look)
        ends = bootstrap_interval(interquartile_mean, run.returns)
        axes.plot(ends, [place, place], lw=2, **look)
        axes.plot([run.iqm], [place], "|", ms=12, mew=2, **look)
    axes.set_yticks(range(len(settings)), [plain(name) for name in settings])
    axes.invert_yaxis()
    first = next(iter(settings.values()))
    seeds = len(first.returns)
    axes.set_xlabel(f"return of {first.window}: each of {seeds} seeds, IQM, {INTERVAL}")
    axes.set_title(plain(title))
    axes.grid(alpha=0.3)
    return figure
