"""What the figures about options share: heat maps, lanes of options, and where they are saved."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.image import AxesImage
from numpy.typing import ArrayLike

from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.option_use import Activations

SIGNED, AMOUNT = "PuOr", "cividis"  # colour maps that colour-blind eyes can read
UNKNOWN = "#dddddd"
MOST_ANNOTATED = 8  # rows of a square heat map whose numbers are written into it


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


def luminance(color: Any) -> float:
    """Return how bright a colour is, from 0 to 1."""
    return float(np.dot(to_rgb(color), (0.2126, 0.7152, 0.0722)))


def ink(color: Any) -> str:
    """Return what is read on a colour: black or white."""
    return "white" if luminance(color) < 0.5 else "black"


def number_options(axes: Axes, num_options: int, which: str = "xy") -> None:
    """Mark the options of a square heat map by number and colour."""
    for axis in which:
        getattr(axes, f"set_{axis}ticks")(range(num_options))
        labels = getattr(axes, f"get_{axis}ticklabels")()
        for k, label in enumerate(labels):
            label.set_color(option_color(k))
            label.set_fontweight("bold")


def lanes(axes: Axes, episode: Activations, num_options: int, steps: int | None = None) -> None:
    """Draw an episode's activations, one lane an option, up to so many steps."""
    for k in range(num_options):
        here = episode.option == k
        bars = list(zip(episode.start[here], episode.duration[here], strict=True))
        axes.broken_barh(bars, (k - 0.45, 0.9), facecolors=option_color(k), lw=0)
    length = int(episode.duration.sum())
    axes.set(ylim=(num_options - 0.5, -0.5), xlim=(0, min(length, steps or length)))
    number_options(axes, num_options, "y")


def lowest(panels: Sequence[Axes], columns: int) -> Sequence[Axes]:
    """Return the last panel of each column of a grid that is filled row by row."""
    return panels[-columns:]


def small_multiples(
    figure: Any, number: int, columns: int, draw: Callable[[int, Axes], None]
) -> Sequence[Axes]:
    """Draw so many panels in a grid that shares its axes, and leave the rest of it empty."""
    rows = -(-number // columns)
    grid = figure.subplots(rows, min(columns, number), squeeze=False, sharex=True, sharey=True)
    panels = grid.ravel()
    for i, axes in enumerate(panels[:number]):
        draw(i, axes)
    for axes in panels[number:]:
        axes.set_visible(False)
    for axes in lowest(panels[:number], columns):
        axes.tick_params(labelbottom=True)
    return panels[:number]
