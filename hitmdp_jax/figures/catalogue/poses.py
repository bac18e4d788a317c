"""The body at a typical state of each option."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.option_analysis import OptionAnalysis

COLUMNS = 4  # pictures in a row
WIDTH = 1.6  # inches of a picture


def draw(analysis: OptionAnalysis, pictures: Mapping[int, np.ndarray]) -> Figure:
    """Draw the state that is typical of each option, in a frame of the option's colour.

    Args:
      analysis: of a policy.
      pictures: option -> picture [H, W, 3] of that state, as `video.filmstrip.poses` gives them.

    Raises:
      UsageError: there are no pictures.
    """
    if not pictures:
        raise UsageError("The task's typical states cannot be drawn.")
    rows, columns, _ = next(iter(pictures.values())).shape
    across = min(COLUMNS, len(pictures))
    down = -(-len(pictures) // across)
    height = down * (WIDTH * rows / columns + 0.75)
    figure = Figure(figsize=(WIDTH * across, height), layout="constrained")
    every_axes = figure.subplots(down, across, squeeze=False).ravel()
    states, spec = analysis.states, analysis.spec
    for axes, (k, picture) in zip(every_axes, pictures.items(), strict=False):
        axes.imshow(picture)
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set(color=option_color(k), linewidth=4)
        title = f"option {k}\n{analysis.usage[k]:.0%} of steps"
        axes.set_title(title, fontsize="medium", color=option_color(k), fontweight="bold")
        i = analysis.typical[k]
        step = int(states.step[i])
        when = f"step {step}" if spec.dt is None else f"{step * spec.dt:.2f} s"
        axes.set_xlabel(f"episode {states.episode[i] + 1}, {when}")
    for axes in every_axes[len(pictures) :]:
        axes.set_visible(False)
    return figure


FIGURE = Entry(
    "A typical pose of each option",
    Needs.POSES,
    draw,
    Section.STATES,
    "Each picture is a state that the policy visited while the option acted: the one around which "
    "the states of that option lie most densely, as the policy sees them. Below it stands where in "
    "the recorded episodes it is.",
)
