"""Option embeddings and their similarities (App. B.3)."""

from matplotlib.figure import Figure

from hitmdp_jax.figures.embeddings import draw_embeddings, height
from hitmdp_jax.figures.heat_maps import annotate, heat_map
from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.figures.style import number_options
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.visited_states import cosine_similarities


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw all embeddings, and the cosines of the angles between them.

    Raises:
      UsageError: the agent's options are no embeddings.
    """
    rows = analysis.embeddings
    if rows is None:
        raise analysis.without("option embeddings")
    figure = Figure(figsize=(9, 0.8 + 1.6 * height(len(rows))), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3.2, 1))
    draw_embeddings(left, rows)
    left.set_title("option embeddings W")
    image = heat_map(right, cosine_similarities(rows), 1.0, signed=True)
    annotate(right, image)
    number_options(right, len(rows))
    right.set_title("cosine similarity")
    return figure


FIGURE = Entry(
    "Embeddings W and their cosine similarities", Needs.EPISODES, draw, Section.EMBEDDINGS
)
