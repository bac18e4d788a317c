"""The final returns of several runs: their seeds, robust means and shares above a return."""

from collections.abc import Mapping, Sequence
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from hitmdp_jax.figures.style import Style, plain

LONGEST, COLUMNS = 40, 80  # letters of a name in one line, and of the names beside each other


def intervals(
    looks: Mapping[str, Style], scores: Sequence[np.ndarray], middles: ArrayLike, ends: ArrayLike
) -> Figure:
    """Draw each run's interquartile mean with its interval, if known, and a mark for every seed.

    Args:
      looks: name of a run -> how its marks look.
      scores: the seeds' returns of each, [S].
      middles: the interquartile means [R].
      ends: their intervals [R, 2]; NaN where unknown.
    """
    figure = Figure(figsize=(8, 1.0 + 0.35 * len(looks)), layout="constrained")
    axes = figure.subplots()
    every = zip(looks.values(), scores, np.asarray(middles), np.asarray(ends), strict=True)
    for i, (look, x, middle, (low, high)) in enumerate(every):
        axes.plot(x, np.full(len(x), i), "|", color=look.color, alpha=0.6, ms=9)
        axes.plot([low, high], [i, i], color=look.color, lw=2)
        axes.plot([middle], [i], look.marker, color=look.color, ms=8)
    names = [
        plain(fill(f"{name} (n = {len(x)})", LONGEST))
        for name, x in zip(looks, scores, strict=True)
    ]
    axes.set_yticks(range(len(names)), [plain(fill(name, LONGEST)) for name in names])
    axes.set(xlabel="return", ylim=(len(names) - 0.5, -0.5))
    axes.grid(axis="x", alpha=0.3)
    return figure


def profiles(looks: Mapping[str, Style], scores: Sequence[np.ndarray]) -> Figure:
    """Draw the share of seeds above each return: performance profiles (Agarwal et al. 2021)."""
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    axes = figure.subplots()
    for (name, look), x in zip(looks.items(), scores, strict=True):
        x = np.sort(x[np.isfinite(x)])
        above = np.linspace(1.0, 0.0, len(x) + 1)  # and beyond the last, none
        axes.plot(
            np.append(x, x[-1:]),
            above[: 2 * len(x)],
            **look.line,
            drawstyle="steps-pre",
            label=plain(fill(name, LONGEST)),
        )
    axes.set(xlabel="return", ylabel="share of seeds above")
    axes.grid(alpha=0.3)
    columns = max(1, COLUMNS // min(max(map(len, looks)), LONGEST))
    figure.legend(loc="outside upper left", ncols=columns)
    return figure
