"""What a sweep found: its settings, the best first, as a table and a figure."""

from pathlib import Path

from hitmdp_jax.experiments import tables
from hitmdp_jax.figures.curves import draw_figures, save
from hitmdp_jax.figures.sweeps import sweep_figure
from hitmdp_jax.interpret.comparison import sweep_table
from hitmdp_jax.interpret.summary import rank
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
