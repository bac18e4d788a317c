"""How often one algorithm beats each of the others: a forest plot of all experiments."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.experiments.experiment import Experiment
from hitmdp_jax.experiments.published import Cells
from hitmdp_jax.experiments.results_page import improvement, tasks_of
from hitmdp_jax.figures.style import Style, styles

ROW, HEAD = 0.28, 0.9  # inches: a row, and all that is not a row


def forest(experiments: Mapping[str, Experiment], cells: Cells, arm: str = "mopg") -> Figure | None:
    """Draw the probability that a seed of an arm beats one of each other arm.

    It is the mean over tasks, with its 95% interval; 0.5 is level. A figure has a panel for each
    experiment that has at least two tasks with the two arms.

    Args:
      experiments: name -> experiment.
      cells: what is published.
      arm: whose probability it is; experiments without it are left out.

    Returns:
      The figure, or None where there is nothing to draw.
    """
    panels: dict[str, dict[str, tuple[float, float, float]]] = {}
    looks: dict[str, Style] = {}
    for experiment in experiments.values():
        tasks = {x: tasks_of(experiment, cells, arm, x) for x in experiment.arms if x != arm}
        known = {other: here for other, here in tasks.items() if len(here) > 1}
        if known:
            panels[experiment.title] = {
                other: improvement(here, arm, other) for other, here in known.items()
            }
            looks |= styles(
                {other: here[0][other].summary.config.algo["name"] for other, here in known.items()}
            )
    if not panels:
        return None
    heights = [len(rows) for rows in panels.values()]
    drawn = Figure(figsize=(7, sum(heights) * ROW + HEAD * len(panels)), layout="constrained")
    axes = drawn.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for panel, (title, rows) in zip(axes, panels.items(), strict=True):
        panel.axvline(0.5, color="black", lw=1, ls=":")
        for i, (other, (middle, low, high)) in enumerate(rows.items()):
            look = looks[other]
            reach = np.array([[middle - low], [high - middle]])
            panel.errorbar(middle, i, xerr=reach, color=look.color, marker=look.marker, capsize=3)
        panel.set_yticks(range(len(rows)), list(rows))
        panel.set(xlim=(-0.02, 1.02), ylim=(len(rows) - 0.5, -0.5))  # all of a point at 0 or 1
        panel.set_title(title, fontsize="medium", loc="left")
        panel.grid(axis="x", alpha=0.3)
    axes[-1].set_xlabel(f"how often {arm} returns more than … (0.5: as often as not)")
    return drawn
