"""Which class puts a task of gymnax behind Brax's interface, by what the task shows."""

from typing import Any

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
from brax.envs.base import State

from hitmdp_jax.envs.suites.gymnax.four_rooms import RoomsTask
from hitmdp_jax.envs.suites.gymnax.task import KeyedTask

EMPTY = (25, 25, 25)  # a square on which nothing is


class PlanesTask(KeyedTask):
    """A task that shows planes of squares: the tasks of MinAtar, Catch, DeepSea and Pong.

    On a square of a plane is something or nothing. The library says so with 1 and 0, this class
    with booleans, which a rollout keeps in a quarter of the memory.
    """

    def observation(self, obs: Any) -> jax.Array:
        """Return where something is on each plane."""
        return jnp.asarray(obs).astype(bool)

    def draw(self, state: State) -> np.ndarray:
        """Return the picture [H, W, 3] of a state: a pixel a square, a colour a plane."""
        planes = np.asarray(state.obs)
        planes = planes if planes.ndim == 3 else planes[..., None]
        colors = np.array(matplotlib.colormaps["tab10"].colors)  # pyright: ignore
        picture = np.full((*planes.shape[:2], 3), EMPTY, np.uint8)
        for plane in range(planes.shape[-1]):
            picture[planes[..., plane]] = 255 * colors[plane % len(colors)]
        return picture


def kind_of(name: str, task: Any, params: Any) -> type[KeyedTask]:
    """Return the class that puts a task of gymnax behind Brax's interface."""
    if name == "FourRooms-misc":
        return RoomsTask
    shape = getattr(task.observation_space(params), "shape", ())
    return PlanesTask if len(shape) in (2, 3) else KeyedTask
