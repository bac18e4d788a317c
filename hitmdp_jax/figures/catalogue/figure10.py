"""One whole episode as a film above the options that it consists of."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from hitmdp_jax.figures.lanes import LANE, lanes
from hitmdp_jax.figures.registry import Entry, Needs
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.option_analysis import OptionAnalysis

FILM_WIDTH = 9.4  # inches of all pictures of an episode


def draw(analysis: OptionAnalysis, pictures: Mapping[int, np.ndarray]) -> Figure:
    """Draw how the first episode is composed of options, below a film of it if there are pictures.

    Film and options share the axis of time: each picture stands over an equal part of the episode,
    in a border of the colour of the option that acts in it.

    Args:
      analysis: of a policy.
      pictures: step -> picture [H, W, 3] of it, as `video.pictures` gives them; none where nothing
        can be drawn.
    """
    episode, number = analysis.activations[0], analysis.num_options
    strip = 0.6 + 1.5 * LANE * number
    if pictures:
        rows, columns, _ = next(iter(pictures.values())).shape
        film = FILM_WIDTH / len(pictures) * rows / columns
        figure = Figure(figsize=(FILM_WIDTH + 0.6, 0.6 + strip + film), layout="constrained")
        above, axes = figure.subplots(2, sharex=True, height_ratios=(film, strip))
        options = np.asarray(analysis.trajectories.option)[list(pictures), 0].tolist()
        _film(above, list(pictures.values()), options, float(episode.duration.sum()))
        for step in pictures:
            axes.axvline(step, color="black", lw=0.8)
    else:
        figure = Figure(figsize=(7, 0.5 + strip), layout="constrained")
        above = axes = figure.subplots()
    lanes(axes, episode, number)
    returned = analysis.trajectories.returns[0]
    axes.set(xlabel="step", ylabel="option")
    above.set_title(f"episode 1: return {returned:.0f}", loc="left", fontsize="medium")
    return figure


def _film(
    axes: Axes, pictures: Sequence[np.ndarray], options: Sequence[int], length: float
) -> None:
    """Draw pictures side by side over an axis of so many steps, each in its option's colour."""
    width = length / len(pictures)
    for i, (picture, option) in enumerate(zip(pictures, options, strict=True)):
        left, right = (i + 0.02) * width, (i + 0.98) * width
        axes.imshow(picture, extent=(left, right, 0.0, 1.0), aspect="auto")
        frame = Rectangle((left, 0.0), right - left, 1.0, fill=False, ec=option_color(option), lw=3)
        axes.add_patch(frame)
    axes.set(xlim=(0, length), ylim=(-0.03, 1.03))
    axes.axis("off")


FIGURE = Entry("One episode", Needs.PICTURES, draw)
