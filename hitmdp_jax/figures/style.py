"""Colours belong to names: an option and an algorithm look the same in every figure and page."""

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb

from hitmdp_jax.palette import PALETTE, option_color

OWN = PALETTE[-1]  # of an algorithm that does not come with the package
# Ends of arms' names that always look the same; other arms take what is left.
VARIANTS = ("-one", "-held", "-printed")
DASHES = ((4.0, 1.5), (1.0, 1.5), (4.0, 1.5, 1.0, 1.5), (8.0, 2.0), (8.0, 2.0, 1.0, 2.0))
MARKERS = "osD^Xv"


NAMES = (
    "mopg", "ppo", "dac", "ahp", "iopg", "ppoc", "oc", "", "moc", "ppo_gru", "sac", "hit_sac"
)  # "": `OWN`  # fmt: skip
ALGORITHMS = {name: option_color(k) for k, name in enumerate(NAMES) if name}


def ink(color: Any) -> str:
    """Return the text colour that is legible on a colour: black or white."""
    return "white" if np.dot(to_rgb(color), (0.2126, 0.7152, 0.0722)) < 0.5 else "black"


def plain(name: str) -> str:
    """Return a name that Matplotlib shows as it stands: between dollars it reads a formula."""
    return name.replace("$", r"\$")


def number_options(axes: Axes, num_options: int, which: str = "xy") -> None:
    """Mark the options along the axes of that name by their numbers, each in its colour."""
    for axis in which:
        getattr(axes, f"set_{axis}ticks")(range(num_options))
        labels = getattr(axes, f"get_{axis}ticklabels")()
        for k, label in enumerate(labels):
            label.set_color(option_color(k))
            label.set_fontweight("bold")


def shades(number: int) -> list[str]:
    """Return the colours of so many things in order that are neither options nor algorithms."""
    return [to_hex(color) for color in colormaps["plasma"](np.linspace(0.0, 0.6, number))]


class Style(NamedTuple):
    """How an arm is drawn: in its algorithm's colour, and unlike the algorithm's other arms."""

    color: str
    number: int = 0  # among the algorithm's arms; 0 is a solid line

    @property
    def dash(self) -> tuple[float, ...]:
        """The lengths of dashes and gaps, in widths of the line; none where it is solid."""
        if not self.number:
            return ()
        longer, i = divmod(self.number - 1, len(DASHES))
        return tuple(length * (1 + longer) for length in DASHES[i])

    @property
    def line(self) -> dict[str, Any]:
        """What Matplotlib draws a line by."""
        return {"color": self.color, "ls": (0, self.dash) if self.dash else "-"}

    @property
    def plotly(self) -> dict[str, Any]:
        """What Plotly draws a line by."""
        dash = ",".join(f"{3 * length:g}px" for length in self.dash)
        return {"color": self.color, "dash": dash or "solid"}

    @property
    def marker(self) -> str:
        """What Matplotlib draws a point by."""
        return MARKERS[self.number % len(MARKERS)]


def styles(arms: Mapping[str, str]) -> dict[str, Style]:
    """Return how the arms of a picture are drawn, no two alike.

    Args:
      arms: name -> algorithm, as settings name it.
    """
    found: dict[str, Style] = {}
    of_its_own = {
        f"{algorithm}{variant}": number
        for algorithm in arms.values()
        for number, variant in enumerate(("", *VARIANTS))
    }
    for arm in sorted(arms, key=lambda arm: arm not in of_its_own):
        numbers = itertools.chain([of_its_own.get(arm, 0)], itertools.count())
        all_of_them = (Style(color(arms[arm]), number) for number in numbers)
        found[arm] = next(style for style in all_of_them if style not in found.values())
    return {arm: found[arm] for arm in arms}


def color(algorithm: str) -> str:
    """Return an algorithm's colour, by its name in settings."""
    return ALGORITHMS.get(algorithm, OWN)
