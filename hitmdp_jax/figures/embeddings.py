"""Figures of option embeddings, by the paper's numbers: 5 (main text), 12, 13 and 14 (App. B.3)."""

from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator

from hitmdp_jax.errors import UsageError, out_of_domain
from hitmdp_jax.figures.curves import plain
from hitmdp_jax.figures.drawing import annotate, heat_map, limit_of, number_options
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.perturbation import EMBEDDING_SCALE, Perturbation, strongest
from hitmdp_jax.interpret.visited_states import cosine_similarities

ROW = 0.22  # inches of a row of a heat map


def figure5(analysis: OptionAnalysis) -> Figure:
    """Draw all embeddings, and what four dimensions do to the actions under the main option."""
    rows, perturbed = _embedded(analysis, "figure5")
    option = analysis.by_usage[0]
    chosen = strongest(perturbed.slopes[option])[:4]
    heights = 1.2 + height(len(rows)), 1.5 + height(num_actuators(perturbed))
    figure = Figure(figsize=(9, sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(2, height_ratios=heights)
    top, bottom = parts
    _embeddings(top.subplots(), rows)
    top.suptitle("(a) option embeddings W")
    bottom.suptitle(f"(b) the dimensions that move actions most under option {option}")
    panels = bottom.subplots(1, len(chosen), sharey=True, squeeze=False)[0]
    _effects(bottom, panels, perturbed, [(option, e) for e in chosen], analysis.names.actuators)
    return figure


def figure12(analysis: OptionAnalysis) -> Figure:
    """Draw all embeddings, and the cosines of the angles between them."""
    rows, _ = _embedded(analysis, "figure12", perturb=False)
    figure = Figure(figsize=(9, 0.8 + 1.6 * height(len(rows))), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3.2, 1))
    _embeddings(left, rows)
    left.set_title("option embeddings W")
    image = heat_map(right, cosine_similarities(rows), 1.0, signed=True)
    annotate(right, image)
    number_options(right, len(rows))
    right.set_title("cosine similarity")
    return figure


def figure13(
    analysis: OptionAnalysis, option: int | None = None, dimension: int | None = None
) -> Figure:
    """Draw what one dimension of one option's embedding does to every actuator.

    Args:
      analysis: of a policy with embeddings.
      option: None takes the one used most.
      dimension: None takes the one that moves an actuator most.

    Raises:
      UsageError: there are no embeddings, or no such option or dimension.
    """
    rows, perturbed = _embedded(analysis, "figure13")
    option = _in_range("option", analysis.by_usage[0] if option is None else option, len(rows))
    first = strongest(perturbed.slopes[option])[0]
    dimension = _in_range("dimension", first if dimension is None else dimension, rows.shape[1])
    figure = Figure(
        figsize=(5.5, 1.2 + 1.3 * height(num_actuators(perturbed))), layout="constrained"
    )
    panels = [figure.subplots()]
    _effects(figure, panels, perturbed, [(option, dimension)], analysis.names.actuators)
    panels[0].set_title(f"dimension {dimension} of option {option}")
    return figure


def figure14(analysis: OptionAnalysis, options: Sequence[int] | None = None) -> Figure:
    """Draw what the three heaviest dimensions of two options' embeddings do.

    Args:
      analysis: of a policy with embeddings.
      options: None takes the two used most.

    Raises:
      UsageError: there are no embeddings, or no such option.
    """
    rows, perturbed = _embedded(analysis, "figure14")
    wanted = analysis.by_usage[:2] if options is None else options
    chosen = [_in_range("option", option, len(rows)) for option in wanted]
    pairs = [(k, e) for k in chosen for e in np.argsort(-np.abs(rows[k]), kind="stable")[:3]]
    row = 1.0 + height(num_actuators(perturbed))
    figure = Figure(figsize=(9, row * len(chosen)), layout="constrained")
    grid = figure.subplots(len(chosen), len(pairs) // len(chosen), sharey=True, squeeze=False)
    panels = list(grid.ravel())
    _effects(figure, panels, perturbed, pairs, analysis.names.actuators)
    for axes, (k, e) in zip(panels, pairs, strict=True):
        axes.set_title(f"option {k}, dim {e}: W = {rows[k, e]:+.2f}", fontsize="small")
    return figure


def num_actuators(perturbed: Perturbation) -> int:
    """Return A."""
    return perturbed.actions.shape[-1]


def height(rows: int) -> float:
    """Return inches for the rows of a heat map: enough for its colour bar's numbers."""
    return ROW * max(rows, 5)


def _embedded(
    analysis: OptionAnalysis, name: str, perturb: bool = True
) -> tuple[np.ndarray, Perturbation]:
    """Return the embeddings and, if wanted, what perturbing them does.

    Raises:
      UsageError: the agent's options are no embeddings.
    """
    rows = analysis.embeddings
    if rows is None:
        kind = type(analysis.policy.agent).__name__
        raise UsageError(f"{name} shows option embeddings, and {kind} has none.")
    perturbed = analysis.perturbation if perturb else None
    return rows, perturbed  # pyright: ignore[reportReturnType]


def _embeddings(axes: Axes, rows: np.ndarray) -> None:
    image = heat_map(axes, rows, limit_of(rows, EMBEDDING_SCALE), signed=True)
    number_options(axes, len(rows), "y")
    axes.set(xlabel="dimension", ylabel="option")
    axes.figure.colorbar(image, ax=axes, pad=0.01, ticks=MaxNLocator(4))


def _effects(
    figure: Figure,
    panels: Sequence[Axes],
    perturbed: Perturbation,
    pairs: Sequence[tuple[int, int]],
    actuators: Sequence[str],
) -> None:
    """Draw, for pairs of an option and a dimension, how far a shift moves the mean action."""
    image: AxesImage | None = None
    for axes, (k, e) in zip(panels, pairs, strict=True):
        image = _effect(axes, perturbed, k, e, actuators)
        axes.set_title(f"dimension {e}")
    assert image is not None
    figure.supxlabel(fill(perturbed.summary, 110 if len(panels) > 1 else 60), fontsize="small")
    label = "change of the\nmean action"
    figure.colorbar(image, ax=list(panels), label=label, pad=0.02, ticks=MaxNLocator(4))


def _effect(
    axes: Axes, perturbed: Perturbation, option: int, dimension: int, actuators: Sequence[str]
) -> AxesImage:
    shifts, moves = perturbed.shifts, perturbed.moved[option, dimension]
    half = (shifts[1] - shifts[0]) / 2
    extent = (shifts[0] - half, shifts[-1] + half, len(actuators) - 0.5, -0.5)
    image = heat_map(axes, moves.T, perturbed.limit, signed=True, extent=extent)
    axes.set_yticks(range(len(actuators)), list(map(plain, actuators)))
    axes.set(xlabel="shift of W", xticks=(shifts[0], 0.0, shifts[-1]))
    beside = {"transform": axes.get_yaxis_transform(), "va": "center", "fontsize": "small"}
    axes.text(1.02, 1.03, "slope", transform=axes.transAxes, fontsize="small")
    for i, slope in enumerate(perturbed.slopes[option, dimension]):
        axes.text(1.02, i, f"{slope:+z.3f}", **beside)
    return image


def _in_range(name: str, value: int, number: int) -> int:
    """Return a whole number below another.

    Raises:
      UsageError: it is none.
    """
    if not 0 <= value < number:
        raise out_of_domain(name, value, f"a whole number from 0 to {number - 1}")
    return int(value)
