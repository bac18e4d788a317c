"""Which options are active in four episodes, and in which patterns (main text)."""

from matplotlib.figure import Figure

from hitmdp_jax.figures.heat_maps import UNKNOWN
from hitmdp_jax.figures.lanes import LANE, lanes
from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.interpret.option_analysis import OptionAnalysis

EPISODES, STEPS = 4, 512  # which are drawn, as in the paper


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw which options are active as the first episodes begin; grey: it has ended."""
    episodes, returns = analysis.activations[:EPISODES], analysis.trajectories.returns
    height = len(episodes) * (0.5 + LANE * analysis.num_options)
    figure = Figure(figsize=(6, 0.6 + height), layout="constrained")
    panels = figure.subplots(len(episodes), squeeze=False, sharex=True, sharey=True)[:, 0]
    lengths = [int(episode.duration.sum()) for episode in episodes]
    end = min(max(lengths), STEPS)
    for n, (axes, episode) in enumerate(zip(panels, episodes, strict=True)):
        lanes(axes, episode, analysis.num_options)
        axes.set_title(f"episode {n + 1}: return {returns[n]:.0f}", loc="left", fontsize="medium")
        if lengths[n] < end:
            axes.axvspan(lengths[n], end, color=UNKNOWN, lw=0)
    panels[-1].set(xlabel="step", xlim=(0, end))
    figure.supylabel("option")
    return figure


FIGURE = Entry("Which options are active", Needs.EPISODES, draw, Section.TIMES)
