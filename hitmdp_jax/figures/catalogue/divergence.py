"""How far the options' actions are apart."""

from textwrap import fill

from matplotlib.figure import Figure

from hitmdp_jax.figures import heat_maps
from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.interpret.interventions import DISTINCT, alike
from hitmdp_jax.interpret.option_analysis import OptionAnalysis


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw how far the options' actions are apart in the visited states.

    Raises:
      UsageError: the policy has one option.
    """
    analysis.check_several_options()
    found = analysis.divergence
    figure = heat_maps.of_options(
        found, heat_maps.limit_of(found, DISTINCT), row="option", column="option",
        label="mean divergence of actions (nats)", spec=".2g",
    )  # fmt: skip
    figure.suptitle(fill(alike(found), 50), fontsize="small")
    return figure


FIGURE = Entry("How far the options' actions are apart", Needs.EPISODES, draw, Section.DIFFERENCES)
