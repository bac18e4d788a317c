"""One dimension of an embedding: what it does to every actuator (App. B.3)."""

from matplotlib.figure import Figure

from hitmdp_jax.figures.embeddings import draw_changes, embedded, height
from hitmdp_jax.figures.registry import Entry, Needs
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.perturbation import strongest


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw what the dimension that moves an actuator most does under the main option.

    Raises:
      UsageError: the agent's options are no embeddings.
    """
    _, found = embedded(analysis)
    option = analysis.by_usage[0]
    dimension = strongest(found.slopes[option])[0]
    inches = 1.2 + 1.3 * height(len(analysis.spec.action.names))
    figure = Figure(figsize=(5.5, inches), layout="constrained")
    axes = figure.subplots()
    draw_changes(figure, [axes], analysis, [(option, dimension)])
    axes.set_title(f"dimension {dimension} of option {option}")
    return figure


FIGURE = Entry("What one dimension of an embedding does", Needs.EPISODES, draw)
