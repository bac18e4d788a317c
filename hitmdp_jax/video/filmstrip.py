"""Pictures of a recorded episode, and the filmstrip of what the body does under each option."""

import numpy as np
from brax.envs.base import Env
from matplotlib.figure import Figure

from hitmdp_jax.figures.style import option_color, plain
from hitmdp_jax.interpret.episodes import Trajectories
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.video.frames import Scene
from hitmdp_jax.video.pictures import painter_of

THUMBNAIL = (320, 240)  # pixels of a picture
COLUMNS = 8  # pictures in a row


def pictures(env: Env, recorded: Trajectories) -> dict[int, np.ndarray]:
    """Return step -> picture [height, width, 3] of the first episode, one of each equal part of it.

    Args:
      env: the task.
      recorded: the episodes, with what pictures need.

    Raises:
      UsageError: the task cannot be drawn, or nothing can be drawn here.
    """
    scene = Scene(env, recorded, 0)
    with painter_of(env, THUMBNAIL) as painter:
        steps = evenly(np.arange(scene.length)).tolist()
        return {step: painter.paint(*scene.shown(step)) for step in steps}


def poses(analysis: OptionAnalysis) -> dict[int, np.ndarray]:
    """Return option -> picture [height, width, 3] of the state that is typical of it.

    Args:
      analysis: of a policy, whose episodes were recorded with what pictures need.

    Raises:
      UsageError: the task cannot be drawn, or nothing can be drawn here.
    """
    states, recorded = analysis.states, analysis.trajectories
    with painter_of(analysis.env, THUMBNAIL) as painter:
        return {
            k: painter.paint(
                *Scene(analysis.env, recorded, states.episode[i]).shown(states.step[i])
            )
            for k, i in analysis.typical.items()
        }


def filmstrip(env: Env, recorded: Trajectories, title: str = "") -> Figure:
    """Draw what the body does under each option: a row of pictures an option.

    A row's pictures are of the first episode's steps under the option, in order, spread evenly over
    them; below each stands its time. A policy without options has one row of the whole episode.

    Args:
      env: the task.
      recorded: the episodes, with what pictures need.
      title: the figure's title.

    Raises:
      UsageError: nothing can be drawn here.
    """
    scene = Scene(env, recorded, 0)
    rows = _rows(scene)
    figure = Figure(figsize=(1.0 + 1.6 * COLUMNS, 0.4 + 1.5 * len(rows)), layout="constrained")
    every_axes = figure.subplots(len(rows), COLUMNS, squeeze=False)
    with painter_of(env, THUMBNAIL) as painter:
        for axes_of_row, (label, color, steps) in zip(every_axes, rows, strict=True):
            axes_of_row[0].set_ylabel(label)
            chosen = evenly(steps)
            for axes, step in zip(axes_of_row, chosen, strict=False):
                axes.imshow(painter.paint(*scene.shown(step)))
                axes.set_xlabel(scene.moment(step))
                axes.set(xticks=[], yticks=[])
                axes.spines[:].set(color=color, linewidth=3)
            for axes in axes_of_row[len(chosen) :]:
                axes.set_axis_off()
    figure.suptitle(plain(title))
    return figure


def _rows(scene: Scene) -> list[tuple[str, str, np.ndarray]]:
    """Return label, colour and steps of a filmstrip's rows."""
    if scene.option is None:
        return [("whole episode", "black", np.arange(scene.length))]
    started = np.diff(scene.option, prepend=-1) != 0
    rows = []
    for k in np.unique(scene.option):
        steps = np.flatnonzero(scene.option == k)
        share, duration = len(steps) / scene.length, len(steps) / started[steps].sum()
        label = f"option {k}\n{share:.0%} of steps\n{duration:.1f} at a time"
        rows.append((label, option_color(int(k)), steps))
    return rows


def evenly(steps: np.ndarray) -> np.ndarray:
    """Return at most `COLUMNS` of the steps: the middle one of each of so many equal parts."""
    middles = ((np.arange(COLUMNS) + 0.5) / COLUMNS * len(steps)).astype(int)
    return steps[np.unique(middles)]
