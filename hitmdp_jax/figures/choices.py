"""Figures of what a policy's options are for: not in the paper, and asked of every run."""

from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures.curves import plain
from hitmdp_jax.figures.drawing import annotate, heat_map, limit_of, number_options
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.interventions import DISTINCT, alike, effects
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.visited_states import by_option

LABELLED = 0.01  # share of the steps from which an option is named among the states


def causal_figure(analysis: OptionAnalysis) -> Figure:
    """Draw the returns under other choices of options: each episode, mean and standard error."""
    found, effect = analysis.interventions, effects(analysis.interventions)
    number = len(found.names)
    colors = ["black"] * (number - analysis.num_options)
    colors += [option_color(k) for k in range(analysis.num_options)]
    figure = Figure(figsize=(6, 1.2 + 0.3 * number), layout="constrained")
    axes = figure.subplots()
    axes.axvline(effect.mean[0], color="black", lw=1, ls=":")
    for i, color in enumerate(colors):
        axes.plot(found.returns[i], np.full_like(found.returns[i], i), "|", color=color, alpha=0.5)
        error = effect.error[i : i + 1]
        style = {"color": color, "marker": "o", "ms": 7, "capsize": 3}
        axes.errorbar(effect.mean[i : i + 1], [i], xerr=error, **style)
    axes.set_yticks(range(number), found.names)
    axes.set(xlabel="return", ylim=(number - 0.5, -0.5))
    axes.set_title("episodes from the same states, by who chooses the options", fontsize="medium")
    axes.grid(axis="x", alpha=0.3)
    return figure


def transitions_figure(analysis: OptionAnalysis) -> Figure:
    """Draw which option follows which, step by step."""
    label = "share of the next steps"
    return _square(analysis.transitions, 1.0, "option of the next step", "option", label)


def choices_figure(analysis: OptionAnalysis) -> Figure:
    """Draw how probable the master's choice of each option is, after each one.

    Raises:
      UsageError: the agent does not tell its choices' probabilities.
    """
    probs = analysis.choices
    if probs is None:
        raise _without(analysis, "probabilities of choices")
    label = "mean probability of the choice"
    return _square(probs, 1.0, "option that is chosen", "previous option", label)


def divergence_figure(analysis: OptionAnalysis) -> Figure:
    """Draw how far the options' actions are apart in the visited states."""
    found, label = analysis.divergence, "mean divergence of actions (nats)"
    figure = _square(found, limit_of(found, DISTINCT), "option", "option", label)
    figure.suptitle(fill(alike(found), 50), fontsize="small")
    return figure


def attention_figure(analysis: OptionAnalysis) -> Figure:
    """Draw how much the master attends to each option after each one: a step towards its choice.

    What it chooses is what `choices_figure` draws; it may attend to one option and choose another.

    Raises:
      UsageError: the agent's master policy attends to nothing.
    """
    weights = analysis.attention
    if weights is None:
        raise _without(analysis, "attention")
    means = by_option(weights, analysis.states.previous)
    figure = _square(means, 1.0, "option attended to", "previous option", "mean attention weight")
    said = "Attention is a step towards the choice; `choices` shows the choice itself."
    figure.suptitle(fill(said, 50), fontsize="small")
    return figure


def terminations_figure(analysis: OptionAnalysis) -> Figure:
    """Draw how probable it is that each option ends, over the visited states.

    Raises:
      UsageError: the agent's options do not terminate.
    """
    beta = analysis.terminations
    if beta is None:
        raise _without(analysis, "termination functions")
    number = analysis.num_options
    figure = Figure(figsize=(6, 1.2 + 0.35 * number), layout="constrained")
    axes = figure.subplots()
    boxes = axes.boxplot(
        list(beta.T), positions=range(number), orientation="horizontal", widths=0.6,
        patch_artist=True, whis=(5, 95), showfliers=False, medianprops={"color": "black"},
    )  # fmt: skip
    for k, box in enumerate(boxes["boxes"]):
        box.set_facecolor(option_color(k))
    number_options(axes, number, "y")
    axes.set(xlabel="termination probability (median, quartiles, 5% and 95%)", ylabel="option")
    axes.set(xlim=(0, 1), ylim=(number - 0.5, -0.5))
    axes.grid(axis="x", alpha=0.3)
    return figure


def projection_figure(analysis: OptionAnalysis) -> Figure:
    """Draw the visited states in two dimensions, coloured by the active option."""
    projection, option = analysis.projection, analysis.states.option
    figure = Figure(figsize=(6, 5), layout="constrained")
    axes = figure.subplots()
    mixed = np.random.default_rng(0).permutation(len(option))  # no option lies on top
    colors = [option_color(k) for k in option[mixed]]
    axes.scatter(*projection.points[mixed].T, c=colors, s=10, alpha=0.6, lw=0)
    for k, share in enumerate(analysis.usage):
        if share >= LABELLED and (option == k).any():
            centre = np.median(projection.points[option == k], axis=0)
            axes.text(
                centre[0], centre[1], f"{k}", color=option_color(k), fontweight="bold",
                ha="center", va="center", fontsize="x-large",
                path_effects=[withStroke(linewidth=3, foreground="white")],
            )  # fmt: skip
    labels = [_component(analysis, i) for i in range(2)]
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.set_title("visited states by the active option", fontsize="medium")
    return figure


def _component(analysis: OptionAnalysis, i: int) -> str:
    weights = np.abs(analysis.projection.components[i])
    most = ", ".join(plain(analysis.names.observations[j]) for j in np.argsort(-weights)[:3])
    share = analysis.projection.explained[i]
    return f"component {i + 1}: {share:.0%} of the variance\n({most}, ...)"


def _square(values: np.ndarray, limit: float, xlabel: str, ylabel: str, label: str) -> Figure:
    size = max(3.4, 0.3 * len(values) + 1.2)
    figure = Figure(figsize=(size + 1.2, size), layout="constrained")
    axes = figure.subplots()
    image = heat_map(axes, values, limit)
    annotate(axes, image)
    number_options(axes, len(values))
    axes.set(xlabel=xlabel, ylabel=ylabel)
    figure.colorbar(image, label=label)
    return figure


def _without(analysis: OptionAnalysis, what: str) -> UsageError:
    return UsageError(f"{type(analysis.policy.agent).__name__} has no {what} to draw.")
