"""Proposition 3.5: how returns scatter around V-bar, and how they scatter around V."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hitmdp_jax.figures.registry import Entry, Needs
from hitmdp_jax.figures.style import shades
from hitmdp_jax.figures.theorems import TERMINATIONS, variances
from hitmdp_jax.theory.model import OptionModel
from hitmdp_jax.theory.variance import VarianceDecomposition

SCATTERED = (0.0, 0.1, 1.0)  # the terminations whose states are drawn one by one
AROUND_V = r"$\mathbb{E}\,[(G_t - V[s_t])^2 \mid s_t]$"
AROUND_V_BAR = r"$\mathbb{E}\,[(G_t - \bar V[s_t, o_{t-1}])^2 \mid s_t]$"


def draw(models: OptionModel) -> Figure:
    """Plot the variances of the models, and those where one previous option occurs."""
    return plot(variances(models), variances(models, (0.1,), at_start=True))


def plot(parts: VarianceDecomposition, at_start: VarianceDecomposition) -> Figure:
    """Plot how returns scatter around V-bar against how they scatter around V (Proposition 3.5).

    Left, each point is a state of a model; on the diagonal V-bar tells no more than V. Right, the
    ratio of the two over all states, against the termination probability.

    Args:
      parts: [terminations, models, S], as `variances` gives them.
      at_start: the same where one previous option occurs, of any terminations.
    """
    figure = Figure(figsize=(10, 4.7), layout="constrained")
    points, ratios = figure.subplots(1, 2)
    ratio = np.asarray(parts.within / parts.total).reshape(len(TERMINATIONS), -1)
    _range(ratios, ratio)
    for termination, color, marker in zip(SCATTERED, shades(len(SCATTERED)), "o^s", strict=True):
        i = TERMINATIONS.index(termination)
        style = {"color": color, "marker": marker, "lw": 0}
        label = rf"$\beta = {termination:g}$"
        points.scatter(parts.total[i], parts.within[i], s=12, alpha=0.7, label=label, **style)
        ratios.plot(termination, np.median(ratio[i]), ms=7, clip_on=False, **style)
    style = {"color": "#777777", "marker": "x", "lw": 0.7, "zorder": 1}
    points.scatter(at_start.total, at_start.within, s=14, label="one $o_{t-1}$ occurs", **style)
    _diagonal(points, 1.05 * float(max(parts.total.max(), at_start.total.max())))
    for axes in (points, ratios):
        axes.grid(alpha=0.3)
        axes.legend(loc="upper left" if axes is points else "lower right")
    return figure


def _diagonal(points: Axes, limit: float) -> None:
    points.axline((0, 0), slope=1, color="black", lw=1)
    points.set(
        xlabel=AROUND_V,
        ylabel=AROUND_V_BAR,
        title=r"Proposition 3.5, corrected: $\bar V$ errs no more than $V$",
        xlim=(0, limit),
        ylim=(0, limit),
        aspect="equal",
    )
    points.locator_params(nbins=4)


def _range(ratios: Axes, ratio: np.ndarray) -> None:
    ends = ratio.min(axis=1), ratio.max(axis=1)
    ratios.fill_between(TERMINATIONS, *ends, color="#bbbbbb", alpha=0.5, lw=0)
    median = np.median(ratio, axis=1)
    ratios.plot(TERMINATIONS, median, color="black", label="median and range of states")
    ratios.set(
        xlabel=r"termination probability $\beta$",
        ylabel=rf"{AROUND_V_BAR} $/$ {AROUND_V}",
        title="equal where every option terminates",
        ylim=(0, 1.05),
    )


FIGURE = Entry("Proposition 3.5", Needs.MODELS, draw)
