"""The dimensions that matter most in two options (App. B.3)."""

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.figures.embeddings import draw_changes, embedded, height
from hitmdp_jax.figures.registry import Entry, Needs
from hitmdp_jax.interpret.option_analysis import OptionAnalysis


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw what the three heaviest dimensions of the two options used most do.

    Raises:
      UsageError: the agent's options are no embeddings.
    """
    rows, _ = embedded(analysis)
    options = analysis.by_usage[:2]
    pairs = [(k, e) for k in options for e in np.argsort(-np.abs(rows[k]), kind="stable")[:3]]
    inches = len(options) * (1.0 + height(len(analysis.spec.action.names)))
    figure = Figure(figsize=(9, inches), layout="constrained")
    grid = figure.subplots(len(options), len(pairs) // len(options), sharey=True, squeeze=False)
    panels = list(grid.ravel())
    draw_changes(figure, panels, analysis, pairs)
    for axes, (k, e) in zip(panels, pairs, strict=True):
        axes.set_title(f"option {k}, dim {e}: W = {rows[k, e]:+.2f}", fontsize="small")
    return figure


FIGURE = Entry("The heaviest dimensions of two options", Needs.EPISODES, draw)
