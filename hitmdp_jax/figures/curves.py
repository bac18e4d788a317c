"""Figures of a run, drawn from its metrics.csv alone."""

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, FuncFormatter, LogLocator, NullFormatter

from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures.style import Style, color, option_color, plain
from hitmdp_jax.learning.options import mean_duration
from hitmdp_jax.runs.folder import FIGURES, replaced, subfolder
from hitmdp_jax.runs.metrics import read_metrics

TITLE = 45  # letters of a figure's title on one line
WINDOW = 20  # iterations a curve is smoothed over, as in the paper's figures
THIN, FAINT = 0.7, 0.5  # width and opacity of a single seed's line


def window_sum(
    x: np.ndarray, steps: np.ndarray, switch_at: int | None, window: int = WINDOW
) -> np.ndarray:
    """Return the sum [S, n] of each curve's last `window` points, those of one task alone.

    Args:
      x: the curves [S, n].
      steps: environment steps at the points [n], ascending.
      switch_at: environment steps after which a transfer's second task began; None of one task.
      window: how many points, at most: fewer stand at the beginning of a task.
    """
    begins = [] if switch_at is None else [np.searchsorted(steps, switch_at, side="right")]
    sums = []
    for of_task in np.split(x, begins, axis=1):
        total = np.cumsum(of_task, axis=1)
        total[:, window:] -= total[:, :-window].copy()
        sums.append(total)
    return np.concatenate(sums, axis=1)


def smooth(
    x: np.ndarray, steps: np.ndarray, switch_at: int | None, window: int = WINDOW
) -> np.ndarray:
    """Return the mean [S, n] of each curve's last `window` points, the finite ones of one task.

    Args are those of `window_sum`.
    """
    known = np.isfinite(x)
    total, count = (
        window_sum(part, steps, switch_at, window) for part in (np.where(known, x, 0.0), known)
    )
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def plain_log(axis: Axis) -> None:
    """Label a logarithmic axis 1, 2, 5, 10, 20, ... instead of by powers of ten."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def draw_seeds(
    axes: Axes,
    metrics: dict[str, np.ndarray],
    style: Style,
    label: str | None = None,
    switch_at: int | None = None,
) -> None:
    """Draw the smoothed return of every seed, thin, and their mean and standard deviation.

    A seed that failed is seen, and not averaged away; there is a mean only where every seed has a
    return.
    """
    steps = metrics["env_steps"][0]
    returns = smooth(metrics["episode_return"], steps, switch_at)
    draw_mean(axes, steps, returns, style, label)
    if len(returns) > 1:
        axes.plot(steps, returns.T, **style.line, lw=THIN, alpha=FAINT)


def draw_mean(
    axes: Axes, steps: np.ndarray, returns: np.ndarray, style: Style, label: str | None = None
) -> None:
    """Draw the mean and standard deviation of seeds' curves [S, n] where all of them are known."""
    known = ~np.isnan(returns).any(axis=0)
    mean, std = returns[:, known].mean(axis=0), returns[:, known].std(axis=0)
    axes.plot(steps[known], mean, **style.line, label=label and plain(label))
    if len(returns) > 1:
        band = {"color": style.color, "alpha": 0.2, "lw": 0}
        axes.fill_between(steps[known], mean - std, mean + std, **band)


def label_steps(axes: Axes) -> None:
    """Count environment steps along the horizontal axis: 0, 200k, ..., 1M."""
    axes.set(xlabel="environment steps")
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))


def label_curves(axes: Axes, title: str, switch_at: int | None) -> None:
    """Name the axes of learning curves, and mark where a transfer's second task began."""
    label_steps(axes)
    axes.set(
        ylabel=f"episode return, mean over {WINDOW} iterations",
        title=fill(plain(title), TITLE),
    )
    axes.grid(alpha=0.3)
    mark_switch(axes, switch_at)


def mark_switch(axes: Axes, switch_at: int | None) -> None:
    """Mark where a transfer's second task began, if there is one."""
    if switch_at is not None:
        axes.axvline(switch_at, color="black", ls="--", lw=1)


def learning_curve(
    metrics: dict[str, np.ndarray], title: str, algorithm: str, switch_at: int | None = None
) -> Figure:
    """Plot the training return against environment steps.

    Args:
      metrics: as `read_metrics` gives them.
      title: the figure's title.
      algorithm: whose colour the curves have, as settings name it.
      switch_at: environment steps after which a transfer's second task began; it is marked.
    """
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    num_seeds = len(metrics["env_steps"])
    label = f"mean and standard deviation of {num_seeds} seeds" if num_seeds > 1 else None
    style = Style(color(algorithm))
    draw_seeds(axes, metrics, style, label, switch_at)
    if label:
        axes.plot([], [], **style.line, lw=THIN, alpha=FAINT, label="each seed")
        axes.legend(framealpha=1.0)
    label_curves(axes, title, switch_at)
    return figure


def count_options(metrics: Mapping[str, np.ndarray], name: str) -> int:
    """Return K of the run of that name.

    Raises:
      UsageError: the run has no options, or no iteration yet.
    """
    if not metrics:
        raise UsageError(f"The run {name} has no iteration yet.")
    number = sum(column.startswith("option_steps_") for column in metrics)
    if not number:
        raise UsageError(f"The run {name} has no options to look into.")
    return number


def option_curves(
    metrics: Mapping[str, np.ndarray], switch_at: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return each option's share of the steps and mean duration, [K, n], over `WINDOW` iterations.

    They are those of the first seed: options have no common order across seeds.

    Args:
      metrics: as `read_metrics` gives them, of a run with options.
      switch_at: environment steps after which a transfer's second task began; None of one task.
    """
    num_options = sum(name.startswith("option_steps_") for name in metrics)
    steps = metrics["env_steps"][0]
    counts, starts = (
        window_sum(
            np.nan_to_num([metrics[f"{name}_{k}"][0] for k in range(num_options)]),
            steps,
            switch_at,
        )
        for name in ("option_steps", "option_activations")
    )
    return counts / np.maximum(counts.sum(axis=0), 1.0), mean_duration(counts, starts)


def option_durations(
    metrics: Mapping[str, np.ndarray], title: str, switch_at: int | None = None
) -> Figure:
    """Plot each option's mean duration and share of steps against environment steps (Figure 6).

    One seed's options are plotted, the first's. Args are those of `learning_curve`.
    """
    figure = Figure(figsize=(6, 6), layout="constrained")
    duration_axes, usage_axes = figure.subplots(2, sharex=True)
    steps = metrics["env_steps"][0]
    shares, durations = option_curves(metrics, switch_at)
    colors = [option_color(k) for k in range(len(shares))]
    for k, duration in enumerate(durations):
        duration_axes.plot(steps, duration, color=colors[k], label=f"option {k}")
    usage_axes.stackplot(steps, shares, colors=colors)
    duration_axes.set(ylabel="mean duration (steps)", yscale="log", title=fill(plain(title), TITLE))
    duration_axes.grid(alpha=0.3)
    plain_log(duration_axes.yaxis)
    for axes in (duration_axes, usage_axes):
        mark_switch(axes, switch_at)
    usage_axes.set(ylabel="share of steps", ylim=(0, 1))
    usage_axes.margins(x=0)
    label_steps(usage_axes)
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def pixels(figure: Figure) -> np.ndarray:
    """Return a figure as a picture [height, width, 4], 8 bits a colour."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def save(figure: Figure, path: Path, dpi: int = 150) -> None:
    """Write a figure as PNG; Raises as `replaced`."""
    with replaced(path) as file:
        figure.savefig(file, format="png", dpi=dpi)


def draw_figures(
    run_dir: Path,
    title: str,
    algorithm: str,
    switch_at: int | None = None,
    setting: int | None = None,
) -> list[Path]:
    """Draw every figure the run's metrics allow into its `figures/`; return their paths.

    Args:
      run_dir: the run's folder.
      title: the figures' title.
      algorithm: whose colour its curves have, as settings name it.
      switch_at: environment steps after which a transfer's second task began; it is marked.
      setting: the setting of a sweep that is drawn.
    """
    metrics = read_metrics(run_dir)
    if setting is not None:
        chosen = metrics["setting"][:, 0] == setting
        metrics = {name: x[chosen] for name, x in metrics.items()}
    figures = {}
    if "episode_return" in metrics and np.isfinite(metrics["episode_return"]).any():
        figures["learning_curve"] = learning_curve(metrics, title, algorithm, switch_at)
    if "option_steps_0" in metrics:
        figures["option_durations"] = option_durations(metrics, title, switch_at)
    folder = subfolder(run_dir, FIGURES)
    for name, figure in figures.items():
        save(figure, folder / f"{name}.png")
    return [folder / f"{name}.png" for name in figures]
