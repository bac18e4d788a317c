"""What an experiment found as one figure: learning curves, or the options that a sweep uses.

The curves are those of Figures 3 and 4, App. B.1, and the bars those of Figure 11.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hitmdp_jax.experiments.published import Cell
from hitmdp_jax.figures.curves import draw_mean, label_steps, mark_switch, smooth
from hitmdp_jax.figures.style import Style, shades, styles
from hitmdp_jax.interpret.summary import Summary
from hitmdp_jax.training.sweep import PREFIX

WINDOW = 3  # points of a published curve, each a hundredth of the steps
WIDTH, HEIGHT = 4.2, 3.0  # of a panel, in inches
BESIDE, BELOW = 1.8, 0.8  # for the legend: to the right of a single panel, below several


def figure(cells: Mapping[str, Mapping[str, Cell]]) -> Figure | None:
    """Draw a panel for each task: mean and standard deviation of every arm's seeds.

    Of an arm that swept a hyperparameter, whose settings are no seeds of one curve, a panel of its
    own counts the options in use.

    Args:
      cells: those of an experiment, by task and arm.

    Returns:
      The figure, or None where there is nothing to draw.
    """
    curves = {
        task: kept
        for task, known in cells.items()
        if (kept := {arm: cell for arm, cell in known.items() if not cell.summary.swept})
    }
    every = [cell.summary for known in cells.values() for cell in known.values()]
    swept = [run for run in every if run.swept and "options_used" in run.columns]
    if not curves and not swept:
        return None
    number = len(curves) + len(swept)
    columns = {1: 1, 2: 2, 4: 2}.get(number, 3)
    rows = -(-number // columns)
    width = WIDTH * columns + (BESIDE if columns == 1 else 0.0)
    drawn = Figure(figsize=(width, HEIGHT * rows + BELOW), layout="constrained")
    panels = list(drawn.subplots(rows, columns, squeeze=False).ravel())
    algorithms = {
        arm: cell.summary.config.algo["name"] for of in curves.values() for arm, cell in of.items()
    }
    looks = styles(algorithms)
    for axes, (task, kept) in zip(panels, curves.items(), strict=False):
        draw_curves(axes, task, kept, looks)
    for axes, run in zip(panels[len(curves) :], swept, strict=False):
        draw_used_options(axes, run)
    for axes in panels[number:]:
        axes.remove()
    if curves:
        drawn.supylabel("episode return of the training policy", fontsize="medium")
    draw_legend(drawn, panels[:number], columns)
    return drawn


def draw_legend(drawn: Figure, panels: Sequence[Axes], columns: int) -> None:
    """Name what the panels show, once: beside a single column of them, else below."""
    lines = {}  # name -> its mark in the legend
    for axes in panels:
        handles, names = axes.get_legend_handles_labels()
        lines |= zip(names, handles, strict=True)
    if columns == 1:
        drawn.legend(lines.values(), lines, loc="outside right upper")
    else:
        drawn.legend(lines.values(), lines, loc="outside lower center", ncols=4 * columns)


def draw_curves(
    axes: Axes, task: str, cells: Mapping[str, Cell], looks: Mapping[str, Style]
) -> None:
    """Draw the mean and standard deviation of every arm's seeds on a task."""
    switches = {arm: cell.summary.config.switch_at for arm, cell in cells.items()}
    for arm, cell in cells.items():
        steps = cell.curves["env_steps"][0]
        returns = smooth(cell.curves["episode_return"], steps, switches[arm], WINDOW)
        draw_mean(axes, steps, returns, looks[arm], arm)
    for switch_at in set(switches.values()):
        mark_switch(axes, switch_at)
    label_steps(axes)
    seeds = sorted({cell.summary.config.seeds for cell in cells.values()})
    axes.set_title(f"{task}: {' or '.join(map(str, seeds))} seeds")
    axes.grid(alpha=0.3)


def draw_used_options(axes: Axes, run: Summary) -> None:
    """Count the seeds that use k options under each value of what was swept: a bar for each k."""
    values = np.unique(run.columns[run.swept])
    width = 0.8 / run.num_options
    for k, color in enumerate(shades(run.num_options), 1):
        used = run.columns["options_used"] == k
        counts = [int((used & (run.columns[run.swept] == value)).sum()) for value in values]
        places = np.arange(len(values)) + (k - (run.num_options + 1) / 2) * width
        label = f"{k} option{'s' if k > 1 else ''}"
        axes.bar_label(axes.bar(places, counts, width, color=color, label=label), fontsize=8)
    axes.set_xticks(range(len(values)), [f"{value:g}" for value in values])
    axes.set(xlabel=run.swept.removeprefix(PREFIX), ylabel="seeds")
    axes.set_title("options with at least 5% of the last 100k steps", fontsize="medium")
