"""What figures of option embeddings share: W itself, and what shifts of its dimensions do."""

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator

from hitmdp_jax.figures.heat_maps import heat_map, limit_of
from hitmdp_jax.figures.style import number_options, plain
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.perturbation import EMBEDDING_SCALE, TINY, Perturbation

ROW = 0.22  # inches of a row of a heat map


def embedded(analysis: OptionAnalysis) -> tuple[np.ndarray, Perturbation]:
    """Return the embeddings W [K, E], and what shifting them does.

    Raises:
      UsageError: the agent's options are no embeddings.
    """
    if analysis.embeddings is None or analysis.perturbation is None:
        raise analysis.without("option embeddings")
    return analysis.embeddings, analysis.perturbation


def height(rows: int) -> float:
    """Return inches for the rows of a heat map: enough for its colour bar's numbers."""
    return ROW * max(rows, 5)


def limit_of_changes(found: Perturbation) -> float:
    """Return where charts of changes of the actions end: at their noise, or the largest change."""
    return limit_of(np.append(found.moved, found.noise), TINY)


def draw_embeddings(axes: Axes, rows: np.ndarray) -> None:
    """Draw W [K, E]."""
    image = heat_map(axes, rows, limit_of(rows, EMBEDDING_SCALE), signed=True)
    number_options(axes, len(rows), "y")
    axes.set(xlabel="dimension", ylabel="option")
    axes.figure.colorbar(image, ax=axes, pad=0.01, ticks=MaxNLocator(4))


def draw_changes(
    figure: FigureBase,
    panels: Sequence[Axes],
    analysis: OptionAnalysis,
    shifted: Sequence[tuple[int, int]],
) -> None:
    """Draw, a panel each, how far shifts of an option's dimension change its actions.

    Args:
      figure: that holds the panels.
      panels: as many as there are pairs.
      analysis: of a policy with embeddings.
      shifted: pairs of an option and a dimension.
    """
    _, found = embedded(analysis)
    images = [
        _changes(axes, found, option, dimension, analysis.spec.action.names)
        for axes, (option, dimension) in zip(panels, shifted, strict=True)
    ]
    figure.supxlabel(fill(found.summary, 110 if len(panels) > 1 else 60), fontsize="small")
    label = f"change of the\n{found.quantity}"
    figure.colorbar(images[-1], ax=list(panels), label=label, pad=0.02, ticks=MaxNLocator(4))


def _changes(
    axes: Axes, found: Perturbation, option: int, dimension: int, actuators: Sequence[str]
) -> AxesImage:
    shifts, moves = found.shifts, found.moved[option, dimension]
    half = (shifts[1] - shifts[0]) / 2
    extent = (shifts[0] - half, shifts[-1] + half, len(actuators) - 0.5, -0.5)
    image = heat_map(axes, moves.T, limit_of_changes(found), signed=True, extent=extent)
    axes.set_yticks(range(len(actuators)), list(map(plain, actuators)))
    axes.set(xlabel="shift of W", xticks=(shifts[0], 0.0, shifts[-1]))
    axes.set_title(f"dimension {dimension}")
    beside = {"transform": axes.get_yaxis_transform(), "va": "center", "fontsize": "small"}
    axes.text(1.02, 1.03, "slope", transform=axes.transAxes, fontsize="small")
    for i, slope in enumerate(found.slopes[option, dimension]):
        axes.text(1.02, i, f"{slope:+z.3f}", **beside)
    return image
