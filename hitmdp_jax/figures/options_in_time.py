"""Figures of what options do in time, by the numbers of App. B.2: 6 to 10.

Two figures of the paper are called 5 and two are called 6. `figure5` is the main text's, the
interpretation of embeddings; the other is what `reproduce compare` draws. `figure6` is App. B.2's,
durations in training; the main text's composing patterns are `figure7`.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from hitmdp_jax.errors import UsageError, out_of_domain
from hitmdp_jax.figures.curves import (
    label_steps,
    mark_switch,
    option_curves,
    option_durations,
    plain,
    plain_log,
)
from hitmdp_jax.figures.drawing import UNKNOWN, lanes, lowest, small_multiples
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.option_analysis import OptionAnalysis

STRIP_STEPS = 512  # of an episode in Figure 7, as in the paper
LANE = 0.16  # inches of an option's lane
FILM_WIDTH = 9.4  # inches of all pictures of an episode
Metrics = Mapping[str, np.ndarray]


def figure6(metrics: Metrics, title: str, switch_at: int | None = None) -> Figure:
    """Draw each option's duration and share of steps in training.

    Args:
      metrics: of one seed, [1, iterations], as `read_metrics` gives them.
      title: the figure's title.
      switch_at: environment steps after which a transfer's second task began; it is marked.

    Raises:
      UsageError: the run has no options, or no iteration yet.
    """
    _count_options(metrics, title)
    return option_durations(metrics, title, switch_at)


def figure7(analysis: OptionAnalysis, number: int = 4) -> Figure:
    """Draw which options are active in the first 512 steps of some episodes; grey: it has ended."""
    episodes = analysis.activations[:number]
    returns, height = analysis.trajectories.returns, 0.5 + LANE * analysis.num_options
    figure = Figure(figsize=(6, 0.6 + len(episodes) * height), layout="constrained")

    def draw(n: int, axes: Axes) -> None:
        lanes(axes, episodes[n], analysis.num_options, STRIP_STEPS)
        axes.set_title(f"run {n + 1}: return {returns[n]:.0f}", loc="left", fontsize="medium")

    panels = small_multiples(figure, len(episodes), 1, draw)
    lengths = [int(episode.duration.sum()) for episode in episodes]
    end = min(max(lengths), STRIP_STEPS)
    for axes, length in zip(panels, lengths, strict=True):
        if length < end:
            axes.axvspan(length, end, color=UNKNOWN, lw=0)
    panels[-1].set(xlabel="step", xlim=(0, end))
    figure.supylabel("option")
    return figure


def figure8(runs: Mapping[str, Metrics], switches: Mapping[str, int | None]) -> Figure:
    """Draw the durations of several runs' options in training side by side.

    Args:
      runs: what each run is called -> its metrics of one seed, [1, iterations].
      switches: the same -> environment steps after which a transfer's second task began, or None.

    Raises:
      UsageError: a run has no options, or no iteration yet.
    """
    numbers = {name: _count_options(metrics, name) for name, metrics in runs.items()}
    columns = min(3, len(runs))
    rows, names = -(-len(runs) // columns), list(runs)
    legend = -(-max(numbers.values()) // (2 * columns))  # its rows
    height = 1.0 + 2.2 * rows + 0.22 * legend
    figure = Figure(figsize=(1.0 + 3.0 * columns, height), layout="constrained")

    def draw(i: int, axes: Axes) -> None:
        metrics, name = runs[names[i]], names[i]
        for k, duration in enumerate(option_curves(metrics, switches[name])[1]):
            axes.plot(metrics["env_steps"][0], duration, color=option_color(k))
        mark_switch(axes, switches[name])
        axes.set_title(plain(name), fontsize="medium")
        axes.set(yscale="log")
        axes.grid(alpha=0.3)
        plain_log(axes.yaxis)

    for axes in lowest(small_multiples(figure, len(runs), columns, draw), columns):
        label_steps(axes)
    figure.supylabel("mean duration (steps)")
    for k in range(max(numbers.values())):
        figure.axes[0].plot([], [], color=option_color(k), label=f"option {k}")
    figure.legend(loc="outside lower center", ncols=2 * columns)
    return figure


figure9 = figure8  # the paper's has harder tasks


def figure10(
    analysis: OptionAnalysis, episode: int = 0, pictures: Mapping[int, np.ndarray] | None = None
) -> Figure:
    """Draw how one whole episode is composed of options, below a film of it if there are pictures.

    Film and options share the axis of time: each picture stands over an equal part of the episode,
    in a border of the colour of the option that acts in it.

    Args:
      analysis: of a policy.
      episode: which of the recorded episodes.
      pictures: step -> picture [H, W, 3] of it, as `video.pictures` gives them.

    Raises:
      UsageError: there is no such episode.
    """
    if not 0 <= episode < len(analysis.activations):
        last = len(analysis.activations) - 1
        raise out_of_domain("episode", episode, f"a whole number from 0 to {last}")
    drawn, number = analysis.activations[episode], analysis.num_options
    strip = 0.6 + 1.5 * LANE * number
    if pictures:
        rows, columns, _ = next(iter(pictures.values())).shape
        film = FILM_WIDTH / len(pictures) * rows / columns
        figure = Figure(figsize=(FILM_WIDTH + 0.6, 0.6 + strip + film), layout="constrained")
        above, axes = figure.subplots(2, sharex=True, height_ratios=(film, strip))
        options = np.asarray(analysis.trajectories.option)[list(pictures), episode].tolist()
        _film(above, list(pictures.values()), options, float(drawn.duration.sum()))
        for step in pictures:
            axes.axvline(step, color="black", lw=0.8)
    else:
        figure = Figure(figsize=(7, 0.5 + strip), layout="constrained")
        above = axes = figure.subplots()
    lanes(axes, drawn, number)
    returned = analysis.trajectories.returns[episode]
    axes.set(xlabel="step", ylabel="option")
    above.set_title(f"episode {episode}: return {returned:.0f}", loc="left", fontsize="medium")
    return figure


def _film(
    axes: Axes, pictures: Sequence[np.ndarray], options: Sequence[int], length: float
) -> None:
    """Draw pictures side by side over an axis of so many steps, each in its option's colour."""
    width = length / len(pictures)
    for i, (picture, option) in enumerate(zip(pictures, options, strict=True)):
        left, right = (i + 0.02) * width, (i + 0.98) * width
        axes.imshow(picture, extent=(left, right, 0.0, 1.0), aspect="auto")
        frame = Rectangle((left, 0.0), right - left, 1.0, fill=False, ec=option_color(option), lw=3)
        axes.add_patch(frame)
    axes.set(xlim=(0, length), ylim=(-0.03, 1.03))
    axes.axis("off")


def _count_options(metrics: Metrics, name: str) -> int:
    """Return K.

    Raises:
      UsageError: the run has no options, or no iteration yet.
    """
    if not metrics:
        raise UsageError(f"The run {name} has no iteration yet.")
    number = sum(column.startswith("option_steps_") for column in metrics)
    if not number:
        raise UsageError(f"The run {name} has no options to look into.")
    return number
