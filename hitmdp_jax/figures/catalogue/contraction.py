"""Theorem 3.3: the distance to the fixed point, below gamma^n."""

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.figures.registry import Entry, Needs
from hitmdp_jax.figures.style import shades
from hitmdp_jax.figures.theorems import GAMMAS, contraction
from hitmdp_jax.theory.model import OptionModel


def draw(models: OptionModel) -> Figure:
    """Plot d_n / d_0 against n, below gamma^n (Theorem 3.3): median and range of the models."""
    return plot(contraction(models))


def plot(distances: np.ndarray) -> Figure:
    """Plot distances [gammas, models, n + 1], as `contraction` gives them."""
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    n, floor = np.arange(distances.shape[-1]), 1e-10  # rounding errors stay out of sight
    for gamma, color, curves in zip(GAMMAS, shades(len(GAMMAS)), distances, strict=True):
        bound = gamma**n
        axes.fill_between(n, curves.min(0), curves.max(0), color=color, alpha=0.25, lw=0)
        axes.plot(n, np.median(curves, axis=0), color=color)
        axes.plot(n, bound, color=color, ls="--")
        end = n[bound > floor][-1]
        beside = {"xytext": (4, 2), "textcoords": "offset points"}
        axes.annotate(f"$\\gamma = {gamma}$", (end, bound[end]), **beside)
    for style, label in (
        ("--", r"bound $\gamma^n$"),
        ("-", f"median and range, {distances.shape[1]} models"),
    ):
        axes.plot([], [], color="black", ls=style, label=label)
    axes.set(
        xlabel=r"applications $n$ of $\mathcal{T}^H$",
        ylabel=r"$\|Q^n - Q_A\|_\infty \;/\; \|Q^0 - Q_A\|_\infty$",
        title=r"Theorem 3.3: $\mathcal{T}^H$ contracts by $\gamma$",
        yscale="log",
        xlim=(0, n[-1]),
        ylim=(floor, 2.0),
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="center right", bbox_to_anchor=(1.0, 0.68))
    return figure


FIGURE = Entry("Theorem 3.3", Needs.MODELS, draw)
