"""Where the robot went, from above or over time, coloured by the option in charge."""

from typing import Any

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle

from hitmdp_jax.envs.base import has_model
from hitmdp_jax.envs.option_rewards import COMPASS, directions_of
from hitmdp_jax.envs.suites.maze.maze import GOAL, NEAR, MazeEnv
from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures.registry import Entry, Needs, Section
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.option_analysis import OptionAnalysis

MARKED = ("switch", "goal")  # sites of a model that are drawn where the robot moves along a line


def draw(analysis: OptionAnalysis) -> Figure:
    """Draw the root's path in each recorded episode.

    Raises:
      UsageError: the task has no robot that moves from its place.
    """
    model, names, along = _root(analysis)
    found = analysis.trajectories
    from_above = names == COMPASS
    figure = Figure(figsize=(6, 5 if from_above else 3.2), layout="constrained")
    axes = figure.subplots()
    if from_above:
        x, y = (np.asarray(found.qpos) @ along[i] for i in (0, COMPASS.index("north")))
        _surroundings(axes, getattr(analysis.env, "unwrapped", analysis.env), found)
        axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    else:
        y = np.asarray(found.qpos) @ along[0]
        x = np.broadcast_to(np.arange(len(y))[:, None], y.shape)
        for name in MARKED:
            if (site := mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)) >= 0:
                axes.axhline(model.site_pos[site, 0], color="black", lw=1, ls=":")
                axes.annotate(name, (0, model.site_pos[site, 0]), va="bottom", fontsize="small")
        axes.set(xlabel="step", ylabel="x (m)")
    option, alive = np.asarray(found.option), np.asarray(found.alive)
    for n in range(option.shape[1]):
        _path(axes, x[alive[:, n], n], y[alive[:, n], n], option[alive[:, n], n])
    axes.autoscale_view()
    used = np.unique(option[alive])
    handles = [Line2D([], [], color=option_color(k), label=f"option {k}") for k in used]
    axes.legend(handles=handles, fontsize="small", loc="best")
    axes.grid(alpha=0.3)
    return figure


def _root(analysis: OptionAnalysis) -> tuple[mujoco.MjModel, tuple[str, ...], np.ndarray]:
    """Return the task's model and the directions in which its root moves; raises as `draw`."""
    env: Any = getattr(analysis.env, "unwrapped", analysis.env)
    if not has_model(env):
        raise UsageError("The task has no MuJoCo model, so no robot whose path could be drawn.")
    names, along = directions_of(env.model)
    if not names:
        raise UsageError("The task's robot stays in one place, so there is no path to draw.")
    return env.model, names, along


def _surroundings(axes: Axes, env: Any, found: Any) -> None:
    """Draw a maze's walls and the goal of every episode."""
    if not isinstance(env, MazeEnv):
        return
    cell = env.maze.cell
    for x, y in env.maze.walls:
        corner = (x - cell / 2, y - cell / 2)
        axes.add_patch(Rectangle(corner, cell, cell, color="black", alpha=0.25, lw=0))
    for goal in np.unique(np.asarray(found.qpos)[0][:, GOAL], axis=0):
        axes.plot(*goal, "*", color="black", ms=8, zorder=3)
        axes.add_patch(Circle(tuple(goal), NEAR, fill=False, lw=0.5))


def _path(axes: Axes, x: np.ndarray, y: np.ndarray, option: np.ndarray) -> None:
    """Draw one episode, each step in its option's colour, from a dot where it begins."""
    points = np.stack([x, y], axis=1)
    steps = np.stack([points[:-1], points[1:]], axis=1)
    colors = [option_color(k) for k in option[:-1]]
    # As pixels: a thousand lines an episode would be most of the page.
    lines = LineCollection(list(steps), colors=colors, lw=1.5, alpha=0.8, rasterized=True)
    axes.add_collection(lines)
    axes.plot(x[:1], y[:1], "o", color="black", ms=4, zorder=3)


FIGURE = Entry(
    "Where the robot went",
    Needs.EPISODES,
    draw,
    Section.TIMES,
    "Each line is an episode, from the dot where it begins. Its colour is the option in charge. A "
    "robot that moves in the plane is seen from above; of one that moves along a line, the place "
    "is drawn against the step. A star is a goal, the circle around it is where it counts as "
    "reached, and grey squares are walls.",
)
