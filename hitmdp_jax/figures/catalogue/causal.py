"""The returns where something else chooses the options."""

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.interventions import effects
from hitmdp_jax.interpret.option_analysis import OptionAnalysis


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw each episode's return, their mean and its standard error, by who chooses the options.

    Raises:
      UsageError: the policy has one option.
    """
    analysis.check_several_options()
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


FIGURE = Entry(
    "Returns by who chooses the options",
    Needs.EPISODES,
    draw,
    Section.DIFFERENCES,
    "The same policy from the same initial states; only who chooses the option differs. Each mark "
    "is an episode, each point the mean with its standard error. All of them are of the policy "
    "that was saved; the return above is of episodes in which it was still learning, so that the "
    "two are near each other but not the same.",
)
