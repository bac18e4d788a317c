"""How much of its return each training regains after the switch of a transfer, and how fast."""

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures.curves import WINDOW, label_steps, smooth
from hitmdp_jax.figures.registry import Entry, Needs, RunMetrics, Section
from hitmdp_jax.figures.style import plain, shades
from hitmdp_jax.interpret.returns import final_returns

ENOUGH = 0.5  # of the return before the switch


def draw(run: RunMetrics) -> Figure:
    """Draw the return after the switch as a share of that before it, a line for each training.

    Below it, a mark says when a training has regained half, or that it has not.

    Raises:
      UsageError: there was no switch, or no return before it of which there could be a share.
    """
    steps, shares = regained(run)
    seeds = run.metrics["seed"][:, 0].astype(int)
    colors = shades(len(seeds))
    rows = 0.5 + 0.2 * len(seeds)
    figure = Figure(figsize=(6, 3.4 + rows), layout="constrained")
    above, below = figure.subplots(2, sharex=True, height_ratios=(3.0, rows))
    for level in (1.0, ENOUGH):
        above.axhline(level, color="black", lw=1, ls=":")
    for row, (share, color) in enumerate(zip(shares, colors, strict=True)):
        above.plot(steps, share, color=color)
        (reached,) = np.nonzero(share >= ENOUGH)
        if reached.size:
            first = steps[reached[0]]
            below.plot([0, first], [row, row], color=color)
            below.plot([first], [row], "o", color=color)
            below.annotate(
                f"{first:,.0f} steps", (first, row), (8, 0), textcoords="offset points", va="center"
            )
        else:
            below.annotate(f"not in {steps[-1]:,.0f} steps", (0, row), va="center")
    above.set(ylabel=f"share of the return\nbefore the switch,\nover {WINDOW} iterations")
    above.set_ylim(bottom=min(0.0, above.get_ylim()[0]))
    above.set_title(plain(run.title), fontsize="medium")
    below.set_yticks(range(len(seeds)), [f"seed {seed}" for seed in seeds])
    for label, color in zip(below.get_yticklabels(), colors, strict=True):
        label.set_color(color)
    label_steps(below)
    below.set(ylim=(len(seeds) - 0.5, -0.5), xlabel="environment steps since the switch")
    below.set_title("half of it is regained after", fontsize="medium", loc="left")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    return figure


def regained(run: RunMetrics) -> tuple[np.ndarray, np.ndarray]:
    """Return environment steps since the switch [n], and the shares [R, n]; raises as `draw`."""
    steps, switch_at = run.metrics["env_steps"][0], run.switch_at
    if switch_at is None or steps[-1] <= switch_at:
        raise UsageError(f"{run.title} has not switched to a second task.")
    after = steps > switch_at
    before = final_returns({name: x[:, ~after] for name, x in run.metrics.items()}, None)
    if not (before > 0).all():
        raise UsageError("A return before the switch is not positive: nothing is a share of it.")
    returns = smooth(run.metrics["episode_return"], steps, switch_at)[:, after]
    return steps[after] - switch_at, returns / before[:, None]


FIGURE = Entry(
    "What is regained after the switch",
    Needs.TRAININGS,
    draw,
    Section.LEARNING,
    "Each line is a training: its return on the second task, divided by its return in the last "
    "100,000 steps on the first task, or in all of them if there were fewer. The two tasks may pay "
    "differently, so a share of 1 need not mean that it does the second task as well as it did the "
    "first.",
)
