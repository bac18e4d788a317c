"""How the return changes if something else chooses the options."""

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.interventions import effects
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.verdict import NEGLIGIBLE


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw what other choices of options change: each pair of episodes, the mean, its interval.

    Raises:
      UsageError: the policy has one option.
    """
    analysis.check_several_options()
    found, effect = analysis.interventions, effects(analysis.interventions)
    others = range(1, len(found.names))  # the policy's own choices are the line at zero
    colors = ["black"] * (len(others) - analysis.num_options)
    colors += [option_color(k) for k in range(analysis.num_options)]
    figure = Figure(figsize=(6, 1.2 + 0.3 * len(others)), layout="constrained")
    axes = figure.subplots()
    axes.axvline(0.0, color="black", lw=1, ls=":")
    margin = NEGLIGIBLE * abs(effect.mean[0])
    axes.axvspan(-margin, margin, color="black", alpha=0.07, lw=0)
    for row, (i, color) in enumerate(zip(others, colors, strict=True)):
        each = found.returns[i] - found.returns[0]
        axes.plot(each, np.full_like(each, row), "|", color=color, alpha=0.4)
        style = {"color": color, "marker": "o", "ms": 7, "capsize": 3}
        axes.errorbar(effect.difference[i], row, xerr=effect.half_width[i : i + 1], **style)
    axes.set_yticks(range(len(others)), found.names[1:])
    axes.set(xlabel="return minus that of the policy's own choices")
    axes.set_ylim(len(others) - 0.5, -0.5)
    axes.grid(axis="x", alpha=0.3)
    return figure


FIGURE = Entry(
    "What other choices of options change",
    Needs.EPISODES,
    draw,
    Section.DIFFERENCES,
    "Each mark is a pair of episodes from one initial state: the return with other choices of "
    "options, minus the return with the policy's own. The point is their mean, with its 95% "
    "interval. The grey band is 5% of the return. Own, shuffled: the same options for as long, in "
    "a random order. Uniform choices: an option drawn at random at every step. Uniform, held: one "
    "drawn at random and kept as long as one of the policy's own. First choice: the "
    "episode's first option, kept to the end. Option k: that option alone. All of these are of the "
    "policy that was saved; the return above is of the episodes that it learned from, so the two "
    "differ a little.",
)
