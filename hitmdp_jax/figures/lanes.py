"""The options of an episode in time, one lane per option."""

from matplotlib.axes import Axes

from hitmdp_jax.figures.style import number_options, option_color
from hitmdp_jax.interpret.option_use import Activations

LANE = 0.16  # inches of an option's lane


def lanes(axes: Axes, episode: Activations, num_options: int) -> None:
    """Draw an episode's activations, one lane per option."""
    for k in range(num_options):
        here = episode.option == k
        bars = list(zip(episode.start[here], episode.duration[here], strict=True))
        axes.broken_barh(bars, (k - 0.45, 0.9), facecolors=option_color(k), lw=0)
    axes.set(ylim=(num_options - 0.5, -0.5), xlim=(0, int(episode.duration.sum())))
    number_options(axes, num_options, "y")
