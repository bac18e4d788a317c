"""Which option follows which, step by step."""

from matplotlib.figure import Figure

from hitmdp_jax.figures import heat_maps
from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.interpret.option_analysis import OptionAnalysis


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw the share of each option among the steps after one under each option.

    Raises:
      UsageError: the policy has one option.
    """
    analysis.check_several_options()
    return heat_maps.of_options(
        analysis.transitions, 1.0, row="option", column="option of the next step",
        label="share of the next steps",
    )  # fmt: skip


FIGURE = Entry("Which option follows", Needs.EPISODES, draw, Section.TIMES)
