"""The learning curves that a table's numbers are the ends of (Figures 3 and 4, App. B.1)."""

from pathlib import Path

from matplotlib.figure import Figure

from hitmdp_jax.experiments.results import read_curve
from hitmdp_jax.experiments.results_page import Suite
from hitmdp_jax.figures.curves import draw_mean, label_steps, smooth
from hitmdp_jax.figures.style import styles

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
    for task, known in suite.published(results).items():
        # A sweep's settings are no seeds of one curve.
        if cells := {arm: cell for arm, cell in known.items() if not cell.swept}:
            published[task] = cells
    if not published:
        return None
    columns = {1: 1, 2: 2, 4: 2}.get(len(published), 3)
    rows = -(-len(published) // columns)
    drawn = Figure(figsize=(WIDTH * columns, HEIGHT * rows + 0.8), layout="constrained")
    panels = drawn.subplots(rows, columns, squeeze=False).ravel()
    algorithms = {
        arm: cell.config.algo["name"] for cells in published.values() for arm, cell in cells.items()
    }
    looks = styles({arm: algorithms[arm] for arm in suite.arms if arm in algorithms})
    lines = {}  # arm -> its line in the legend
    for axes, (task, cells) in zip(panels, published.items(), strict=False):
        for arm, cell in cells.items():
            switch_at = cell.config.switch_at
            curves = read_curve(results / task / arm, switch_at)
            steps = curves["env_steps"][0]
            returns = smooth(curves["episode_return"], steps, switch_at, WINDOW)
            draw_mean(axes, steps, returns, looks[arm], arm)
        handles, names = axes.get_legend_handles_labels()
        lines |= zip(names, handles, strict=True)
        for switch_at in {cell.config.switch_at for cell in cells.values()} - {None}:
            axes.axvline(switch_at, color="black", ls="--", lw=1)
        label_steps(axes)
        seeds = sorted({cell.config.seeds for cell in cells.values()})
        axes.set_title(f"{task}: {' or '.join(map(str, seeds))} seeds")
        axes.grid(alpha=0.3)
    drawn.supylabel("episode return of the training policy")
    drawn.legend(lines.values(), lines, loc="outside lower center", ncols=4 * columns)
    for axes in panels[len(published) :]:
        axes.remove()
    return drawn
