"""The four rooms of gymnax (Sutton, Precup & Singh 1999): picture, and rewards for options."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import State

from hitmdp_jax.envs.suites.gymnax.task import KeyedTask

WALL, FREE, GOAL, AGENT = (60, 60, 60), (255, 255, 255), (0, 158, 115), (213, 94, 0)
# A step to each side, and the doors: a row and a column.
SIDES = {"north": (-1, 0), "east": (0, 1), "south": (1, 0), "west": (0, -1)}
DOORS = {"door_north": (3, 6), "door_east": (7, 9), "door_south": (10, 6), "door_west": (6, 2)}


class RoomsTask(KeyedTask):
    """The four rooms. It offers rewards to options: a way for each compass point and each door."""

    def draw(self, state: State) -> np.ndarray:
        """Return the picture [13, 13, 3] of a state: walls, the goal and the agent."""
        rooms: Any = state.pipeline_state
        picture = np.where(np.asarray(self.task.env_map)[..., None], FREE, WALL).astype(np.uint8)
        picture[tuple(np.asarray(rooms.goal))] = GOAL
        picture[tuple(np.asarray(rooms.pos))] = AGENT
        return picture

    def option_rewards(self, before: State, action: jax.Array, after: State) -> dict[str, Any]:
        """Return the cells moved to each side, and the cells come nearer to each door."""
        old, new = self._place(before), self._place(after)
        moved = {name: (new - old) @ jnp.array(step) for name, step in SIDES.items()}
        far = {name: jnp.asarray(cells) for name, cells in self._to_doors.items()}
        nearer = {name: cells[tuple(old)] - cells[tuple(new)] for name, cells in far.items()}
        return moved | nearer

    def _place(self, state: State) -> jax.Array:
        rooms: Any = state.pipeline_state
        return rooms.pos

    @functools.cached_property
    def _to_doors(self) -> dict[str, np.ndarray]:
        """How many steps [13, 13] it takes from each cell to each door."""
        free = np.asarray(self.task.env_map)
        return {name: steps_to(door, free) for name, door in DOORS.items()}


def steps_to(cell: tuple[int, int], free: np.ndarray) -> np.ndarray:
    """Return the steps to a cell from each cell [H, W] of a map; 0 where no way leads to it."""
    steps = np.zeros(free.shape, np.int32)
    reached = np.zeros(free.shape, bool)
    reached[cell] = True
    for count in range(1, free.size):
        beside = np.logical_or.reduce([np.roll(reached, step, (0, 1)) for step in SIDES.values()])
        new = beside & free & ~reached
        steps[new] = count
        reached |= new
    return steps
