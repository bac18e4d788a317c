"""Heat maps: matrices of colours on a scale that lets nothing tiny look large."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import ArrayLike

from hitmdp_jax.figures.style import ink, number_options

SIGNED, AMOUNT = "PuOr", "cividis"  # colour maps that colour-blind eyes can read
UNKNOWN = "#dddddd"
MOST_ANNOTATED = 8  # rows of a heat map whose numbers are written into it


def heat_map(
    axes: Axes, values: np.ndarray, limit: float, *, signed: bool = False, **how: Any
) -> AxesImage:
    """Draw values [rows, columns] up to a limit, NaN in grey; signed ones about a white zero."""
    low = -limit if signed else 0.0
    image = axes.imshow(
        values, cmap=SIGNED if signed else AMOUNT, vmin=low, vmax=limit, aspect="auto", **how
    )
    axes.set_facecolor(UNKNOWN)
    return image


def limit_of(values: ArrayLike, at_least: float) -> float:
    """Return where the colours or the axis of values end, so that nothing tiny looks large.

    Args:
      values: all that are drawn by one scale.
      at_least: what is not to look small.
    """
    values = np.abs(np.asarray(values, float))
    return float(values[np.isfinite(values)].max(initial=at_least))


def annotate(axes: Axes, image: AxesImage, spec: str = ".2f") -> None:
    """Write the numbers into a small heat map."""
    values = np.asarray(image.get_array(), float)
    if len(values) > MOST_ANNOTATED:
        return
    for (i, j), x in np.ndenumerate(values):
        text, color = (format(x, spec), image.to_rgba(x)) if np.isfinite(x) else ("-", UNKNOWN)
        axes.text(j, i, text, ha="center", va="center", color=ink(color))


def of_options(
    values: np.ndarray, limit: float, *, row: str, column: str, label: str, spec: str = ".2f"
) -> Figure:
    """Draw a matrix [K, K] of options by options.

    Args:
      values: NaN where unknown.
      limit: where the colours end.
      row: what an option is in a row.
      column: what it is in a column.
      label: what the values are.
      spec: how the numbers are written.
    """
    size = max(3.4, 0.3 * len(values) + 1.2)
    figure = Figure(figsize=(size + 1.2, size), layout="constrained")
    axes = figure.subplots()
    image = heat_map(axes, values, limit)
    annotate(axes, image, spec)
    number_options(axes, len(values))
    axes.set(xlabel=column, ylabel=row)
    figure.colorbar(image, label=label)
    return figure
