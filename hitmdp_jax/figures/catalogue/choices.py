"""How probable each option is as the master policy's next choice, after each option."""

from matplotlib.figure import Figure

from hitmdp_jax.figures import heat_maps
from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.interpret.option_analysis import OptionAnalysis


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw the mean of P(o_t | s_t, o_{t-1}) over the visited states after each option.

    Raises:
      UsageError: the policy has one option, or does not tell its choices' probabilities.
    """
    analysis.check_several_options()
    if analysis.choices is None:
        raise analysis.without("probabilities of choices")
    return heat_maps.of_options(
        analysis.choices, 1.0, row="previous option", column="option that is chosen",
        label="mean probability of the choice",
    )  # fmt: skip


FIGURE = Entry(
    "How probable the master policy's choice of each option is",
    Needs.EPISODES,
    draw,
    Section.TIMES,
    "P(o_t | s_t, o_{t-1}), mean over the visited states after each option. Which option follows "
    "was drawn with these probabilities.",
)
