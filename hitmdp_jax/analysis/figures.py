"""Figures of a run, drawn from its metrics.csv alone."""

import csv
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.learning.options import mean_duration

WINDOW = 20  # iterations a curve is smoothed over, as in the paper's figures
OPTION_COLORS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#bbbbbb")


def read_metrics(run_dir: Path) -> dict[str, np.ndarray]:
    """Return a run's metrics as arrays [S, iterations] by column name; missing values are NaN."""
    with (run_dir / "metrics.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    columns = {
        name: np.array([float(row[name] or "nan") for row in rows])
        for name in (rows[0] if rows else ())
    }
    num_seeds = len(np.unique(columns["seed"])) if columns else 1
    return {name: x.reshape(-1, num_seeds).T for name, x in columns.items()}


def window_sum(x: np.ndarray, window: int = WINDOW) -> np.ndarray:
    """Return the sum [S, n] of each curve's last `window` points."""
    total = np.cumsum(x, axis=1)
    total[:, window:] -= total[:, :-window].copy()
    return total


def smooth(x: np.ndarray, window: int = WINDOW) -> np.ndarray:
    """Return the mean [S, n] of each curve's last `window` points, NaN left out."""
    known = ~np.isnan(x)
    total, count = window_sum(np.where(known, x, 0.0), window), window_sum(known, window)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def learning_curve(
    metrics: dict[str, np.ndarray], title: str, switch_at: int | None = None
) -> Figure:
    """Plot the training return against environment steps: mean and standard deviation of seeds.

    Args:
      metrics: as `read_metrics` gives them.
      title: the figure's title.
      switch_at: environment steps after which a transfer's second task began; it is marked.
    """
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    steps, returns = metrics["env_steps"][0], smooth(metrics["episode_return"])
    known = ~np.isnan(returns).any(axis=0)
    mean, std = returns[:, known].mean(axis=0), returns[:, known].std(axis=0)
    axes.plot(steps[known], mean, color=OPTION_COLORS[0])
    axes.fill_between(
        steps[known], mean - std, mean + std, color=OPTION_COLORS[0], alpha=0.25, lw=0
    )
    axes.set(xlabel="environment steps", ylabel="episode return", title=title)
    axes.grid(alpha=0.3)
    if switch_at is not None:
        axes.axvline(switch_at, color="black", ls="--", lw=1)
    return figure


def option_durations(metrics: dict[str, np.ndarray], title: str) -> Figure:
    """Plot each option's mean duration and share of steps against environment steps (Figure 6).

    One seed's options are plotted, the first's: options have no common order across seeds.
    """
    figure = Figure(figsize=(6, 6), layout="constrained")
    duration_axes, usage_axes = figure.subplots(2, sharex=True)
    steps = metrics["env_steps"][0]
    names = [name for name in metrics if name.startswith("option_steps_")]
    counts = np.stack([window_sum(metrics[name])[0] for name in names])
    starts = np.stack([window_sum(metrics[n.replace("steps", "activations")])[0] for n in names])
    shares = counts / counts.sum(axis=0)
    for k in range(len(names)):
        color = OPTION_COLORS[k % len(OPTION_COLORS)]
        duration = mean_duration(counts[k], starts[k])
        duration_axes.plot(steps, duration, color=color, label=f"option {k}")
    usage_axes.stackplot(steps, shares, colors=[OPTION_COLORS[k % 7] for k in range(len(names))])
    duration_axes.set(ylabel="mean duration (steps)", yscale="log", title=title)
    duration_axes.legend(ncols=2)
    usage_axes.set(xlabel="environment steps", ylabel="share of steps", ylim=(0, 1))
    return figure


def draw_figures(run_dir: Path, title: str, switch_at: int | None = None) -> list[Path]:
    """Draw every figure the run's metrics allow into its `figures/`; return their paths."""
    metrics = read_metrics(run_dir)
    figures = {}
    if "episode_return" in metrics and not np.isnan(metrics["episode_return"]).all():
        figures["learning_curve"] = learning_curve(metrics, title, switch_at)
    if "option_steps_0" in metrics:
        figures["option_durations"] = option_durations(metrics, title)
    folder = run_dir / "figures"
    folder.mkdir(exist_ok=True)
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=150)
    return [folder / f"{name}.png" for name in figures]
