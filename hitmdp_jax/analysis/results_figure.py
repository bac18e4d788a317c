"""The learning curves that a table's numbers are the ends of (Figures 3 and 4, App. B.1)."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hitmdp_jax.analysis.figures import label_steps, option_color, smooth
from hitmdp_jax.analysis.results import Columns, read, read_curve
from hitmdp_jax.analysis.results_page import Suite

WINDOW = 3  # points of a published curve, each a hundredth of the steps
WIDTH, HEIGHT = 4.2, 3.0  # of a panel, in inches


def figure(suite: Suite, results: Path) -> Figure | None:
    """Draw a panel for each task of a table: mean and standard deviation of every arm's seeds.

    Args:
      suite: the table.
      results: the folder of the published cells.

    Returns:
      The figure, or None where no curve of the table is published.
    """
    published = {}
    for task in suite.tasks:
        known = {arm: cell for arm in suite.arms if (cell := read(results / task / arm))}
        # A sweep's settings are no seeds of one curve.
        if cells := {arm: cell for arm, cell in known.items() if not cell.swept}:
            published[task] = cells
    if not published:
        return None
    columns = {1: 1, 2: 2, 4: 2}.get(len(published), 3)
    rows = -(-len(published) // columns)
    drawn = Figure(figsize=(WIDTH * columns, HEIGHT * rows + 0.5), layout="constrained")
    panels = drawn.subplots(rows, columns, squeeze=False).ravel()
    arms = list(suite.arms)
    for axes, (task, cells) in zip(panels, published.items(), strict=False):
        for arm, cell in cells.items():
            label = f"{arm}, {len(cell.seeds['seed'])} seeds"
            color = option_color(arms.index(arm))
            draw_arm(axes, read_curve(results / task / arm), color, label)
        for switch_at in {cell.config.switch_at for cell in cells.values()} - {None}:
            axes.axvline(switch_at, color="black", ls="--", lw=1)
        label_steps(axes)
        axes.set_title(task)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    drawn.supylabel("episode return of the training policy")
    for axes in panels[len(published) :]:
        axes.remove()
    return drawn


def draw_arm(axes: Axes, curves: Columns, color: str, label: str) -> None:
    """Draw the mean and standard deviation of the seeds that have a return.

    Args:
      axes: where.
      curves: as `read_curve` gives them.
      color: of the line and the band.
      label: the legend's.
    """
    returns = smooth(curves["episode_return"], WINDOW)
    known = ~np.isnan(returns).all(axis=0)
    steps, returns = curves["env_steps"][0][known], returns[:, known]
    mean, std = np.nanmean(returns, axis=0), np.nanstd(returns, axis=0)
    axes.plot(steps, mean, color=color, label=label, lw=1.2)
    axes.fill_between(steps, mean - std, mean + std, color=color, alpha=0.2, lw=0)
