"""What the master policy attends to after each option, a step towards its choice."""

from textwrap import fill

from matplotlib.figure import Figure

from hitmdp_jax.figures import heat_maps
from hitmdp_jax.figures.registry import Entry, Needs
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.visited_states import by_option


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw how much the master attends to each option after each one: a step towards its choice.

    What it chooses is another figure, `choices`; it may attend to one option and choose another.

    Raises:
      UsageError: the agent's master policy attends to nothing.
    """
    if analysis.attention is None:
        raise analysis.without("attention")
    figure = heat_maps.of_options(
        by_option(analysis.attention, analysis.states.previous), 1.0, row="previous option",
        column="option attended to", label="mean attention weight",
    )  # fmt: skip
    said = "Attention is a step towards the choice; `choices` shows the choice itself."
    figure.suptitle(fill(said, 50), fontsize="small")
    return figure


FIGURE = Entry("What the master policy attends to", Needs.EPISODES, draw)
