"""The visited states in two dimensions, coloured by the active option."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.figures.style import option_color, plain
from hitmdp_jax.interpret.option_analysis import OptionAnalysis

LABELLED = 0.01  # share of the steps from which an option is named among the states


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw the visited states along their two principal components."""
    projection, option = analysis.projection, analysis.states.option
    figure = Figure(figsize=(6, 5), layout="constrained")
    axes = figure.subplots()
    mixed = np.random.default_rng(0).permutation(len(option))  # no option lies on top
    colors = [option_color(k) for k in option[mixed]]
    points = projection.points[mixed].T
    axes.scatter(*points, c=colors, s=10, alpha=0.6, lw=0, rasterized=True)
    for k, share in enumerate(analysis.usage):
        if share >= LABELLED and (option == k).any():
            centre = np.median(projection.points[option == k], axis=0)
            axes.text(
                centre[0], centre[1], f"{k}", color=option_color(k), fontweight="bold",
                ha="center", va="center", fontsize="x-large",
                path_effects=[withStroke(linewidth=3, foreground="white")],
            )  # fmt: skip
    axes.set(xlabel=_component(analysis, 0), ylabel=_component(analysis, 1))
    axes.set_title("visited states by the active option", fontsize="medium")
    return figure


def _component(analysis: OptionAnalysis, i: int) -> str:
    weights = np.abs(analysis.projection.components[i])
    most = ", ".join(plain(analysis.spec.observation.names[j]) for j in np.argsort(-weights)[:3])
    share = analysis.projection.explained[i]
    return f"component {i + 1}: {share:.0%} of the variance\n({most}, ...)"


FIGURE = Entry(
    "Visited states in two dimensions",
    Needs.EPISODES,
    draw,
    Section.STATES,
    "Visited states as the policy sees them, along their two principal components.",
)
