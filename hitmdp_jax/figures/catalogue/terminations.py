"""How probable it is that each option ends."""

from matplotlib.figure import Figure

from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.figures.style import number_options, option_color
from hitmdp_jax.interpret.option_analysis import OptionAnalysis


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw how probable it is that each option ends, over the visited states.

    Raises:
      UsageError: the agent's options do not terminate.
    """
    beta = analysis.terminations
    if beta is None:
        raise analysis.without("termination functions")
    number = analysis.num_options
    figure = Figure(figsize=(6, 1.2 + 0.35 * number), layout="constrained")
    axes = figure.subplots()
    boxes = axes.boxplot(
        list(beta.T), positions=range(number), orientation="horizontal", widths=0.6,
        patch_artist=True, whis=(5, 95), showfliers=False, medianprops={"color": "black"},
    )  # fmt: skip
    for k, box in enumerate(boxes["boxes"]):
        box.set_facecolor(option_color(k))
    number_options(axes, number, "y")
    axes.set(xlabel="termination probability (median, quartiles, 5% and 95%)", ylabel="option")
    axes.set(xlim=(0, 1), ylim=(number - 0.5, -0.5))
    axes.grid(axis="x", alpha=0.3)
    return figure


FIGURE = Entry("The probability that each option ends", Needs.EPISODES, draw, Section.STATES)
