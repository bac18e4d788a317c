"""How long options last during training, for several runs side by side (App. B.2)."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hitmdp_jax.figures.curves import (
    count_options,
    label_steps,
    mark_switch,
    option_curves,
    plain_log,
)
from hitmdp_jax.figures.registry import Entry, Needs, RunMetrics
from hitmdp_jax.figures.style import option_color, plain


def draw(runs: Sequence[RunMetrics]) -> Figure:
    """Draw the durations of the options of each run's first seed.

    Raises:
      UsageError: a run has no options, or no iteration yet.
    """
    most = max(count_options(run.metrics, run.title) for run in runs)
    columns = min(3, len(runs))
    rows = -(-len(runs) // columns)
    height = 1.0 + 2.2 * rows + 0.22 * -(-most // (2 * columns))  # the last is the legend's
    figure = Figure(figsize=(1.0 + 3.0 * columns, height), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    panels = grid[: len(runs)]
    for axes, run in zip(panels, runs, strict=True):
        _draw_run(axes, run)
    for axes in grid[len(runs) :]:
        axes.set_visible(False)
    for axes in panels[-columns:]:  # the lowest of each column
        axes.tick_params(labelbottom=True)
        label_steps(axes)
    figure.supylabel("mean duration (steps)")
    for k in range(most):
        panels[0].plot([], [], color=option_color(k), label=f"option {k}")
    figure.legend(loc="outside lower center", ncols=2 * columns)
    return figure


def _draw_run(axes: Axes, run: RunMetrics) -> None:
    for k, duration in enumerate(option_curves(run.metrics, run.switch_at)[1]):
        axes.plot(run.metrics["env_steps"][0], duration, color=option_color(k))
    mark_switch(axes, run.switch_at)
    axes.set_title(plain(run.title), fontsize="medium")
    axes.set(yscale="log")
    axes.grid(alpha=0.3)
    plain_log(axes.yaxis)


FIGURE = Entry("How long options last", Needs.RUNS, draw)
