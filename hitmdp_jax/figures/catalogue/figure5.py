"""Option embeddings, and the dimensions that move actions most (main text)."""

from typing import Any

from matplotlib.figure import Figure

from hitmdp_jax.figures.embeddings import draw_changes, draw_embeddings, embedded, height
from hitmdp_jax.figures.registry import Entry, Needs
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.perturbation import strongest


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw all embeddings, and what four dimensions do to the actions under the main option.

    Raises:
      UsageError: the agent's options are no embeddings.
    """
    rows, found = embedded(analysis)
    option = analysis.by_usage[0]
    chosen = strongest(found.slopes[option])[:4]
    heights = 1.2 + height(len(rows)), 1.5 + height(len(analysis.spec.action.names))
    figure = Figure(figsize=(9, sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(2, height_ratios=heights)
    top, bottom = parts
    draw_embeddings(top.subplots(), rows)
    top.suptitle("(a) option embeddings W")
    bottom.suptitle(f"(b) the dimensions that move actions most under option {option}")
    panels = bottom.subplots(1, len(chosen), sharey=True, squeeze=False)[0]
    draw_changes(bottom, panels, analysis, [(option, e) for e in chosen])
    return figure


FIGURE = Entry("Option embeddings, and what their dimensions do", Needs.EPISODES, draw)
