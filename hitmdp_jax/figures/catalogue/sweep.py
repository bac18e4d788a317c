"""What the settings of a sweep return: two axes as a heat map, one as a line."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.figures.sweeps import sweep_figure
from hitmdp_jax.interpret.summary import Summary


def draw(settings: Mapping[str, Summary]) -> Figure:
    """Draw the returns of a sweep's settings, as `rank` gives them."""
    config = next(iter(settings.values())).config
    return sweep_figure(settings, config.title, config.algo["name"])


FIGURE = Entry(
    "What the settings return",
    Needs.SETTINGS,
    draw,
    Section.LEARNING,
    "IQM is the interquartile mean over seeds: the mean of the middle half of them. The colours of "
    "a heat map reach from the worst setting to the best one, however close these are. Where there "
    "are five seeds or more, a bar is the 95% interval of the IQM.",
)
