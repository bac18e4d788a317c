"""`MazeEnv`: what mazes have in common whichever robot is in them."""

import abc
import dataclasses
from typing import ClassVar, Literal

import jax
import jax.numpy as jnp
from brax.envs.base import State

from hitmdp_jax.envs.base import Drawn, MujocoEnv, Parts
from hitmdp_jax.envs.suites.maze.maps import Maze
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

POSITION = slice(0, 2)  # qpos: the robot's x and y, m
GOAL = slice(-2, None)  # qpos: the goal's
NEAR = 0.45  # m: the goal is reached within this distance
NOISE = 0.25  # of a cell's width: start and goal lie that far from a cell's centre, along x and y

RewardType = Literal["sparse", "dense"]


@dataclasses.dataclass(eq=False, repr=False)
class MazeEnv(MujocoEnv):
    """Reach the goal, which is elsewhere in every episode, as in Gymnasium-Robotics.

    The observation is proprioception, the robot's x and y and the goal's (m): Gymnasium-Robotics'
    dictionary of `observation`, `achieved_goal` and `desired_goal` in one array, in that order.

    `state.metrics["success"]` is 1 from the step on in which an episode reached its goal.

    The keywords are fields. `__post_init__(physics)` of a subclass makes the model and calls
    `MujocoEnv.__init__`.

    Args:
      physics: the engine; see `MujocoEnv`.
      reward_type: "sparse" pays 1 for every step that ends within 0.45 m of the goal, "dense"
        exp(-distance), the distance in m.
      continuing_task: go on at the goal, which stays where it is, to the time limit; else the
        episode terminates there.
    """

    reward_terms = ("reward_goal",)
    maze: ClassVar[Maze]

    physics: dataclasses.InitVar[PhysicsChoice] = "mjx"  # pyright: ignore
    _: dataclasses.KW_ONLY
    reward_type: RewardType = "sparse"
    continuing_task: bool = True

    @abc.abstractmethod
    def proprioception(self, data: PhysicsState) -> jax.Array:
        """Return the robot's observation of its own body."""

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw two cells and a place in each: the robot at rest, and the goal."""
        key_cells, key_places = jax.random.split(key)
        free = jnp.asarray(self.maze.free, jnp.float32)
        cells = jax.random.choice(key_cells, free, (2,), replace=False)
        noise = jax.random.uniform(key_places, (2, 2), jnp.float32, minval=-NOISE, maxval=NOISE)
        start, goal = cells + self.maze.cell * noise
        qpos = jnp.asarray(self.model.qpos0, jnp.float32)
        qpos = qpos.at[POSITION].set(start).at[GOAL].set(goal)
        return qpos, jnp.zeros(self.model.nv)

    def reset_to(self, qpos: jax.Array, qvel: jax.Array, drawn: Drawn | None = None) -> State:
        """Start an episode from given coordinates; the goal's end both qpos [nq] and qvel [nv]."""
        return _with_success(super().reset_to(qpos, qvel, drawn), jnp.zeros((), jnp.float32))

    def step(self, state: State, action: jax.Array) -> State:
        """Advance one control step; see `MujocoEnv.step`."""
        after = super().step(state, action)
        data = after.pipeline_state
        assert isinstance(data, PhysicsState)
        return _with_success(after, jnp.maximum(state.metrics["success"], self._at_goal(data)))

    @property
    def parts(self) -> Parts:
        """The robot's place and the goal, behind the body."""
        return {"place": slice(-4, -2), "goal": slice(-2, None)}

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return proprioception, place and goal."""
        return jnp.concatenate([self.proprioception(data), data.qpos[POSITION], data.qpos[GOAL]])

    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, dict[str, jax.Array]]:
        """Return the reward for being near the goal."""
        dense = jnp.exp(-self._distance(after))
        reward = dense if self.reward_type == "dense" else self._at_goal(after).astype(jnp.float32)
        return reward, {"reward_goal": reward}

    def terminated(self, data: PhysicsState) -> jax.Array:
        """Return whether the goal is reached and ends the episode."""
        return self._at_goal(data) & (not self.continuing_task)

    def _distance(self, data: PhysicsState) -> jax.Array:
        return jnp.linalg.norm(data.qpos[POSITION] - data.qpos[GOAL])

    def _at_goal(self, data: PhysicsState) -> jax.Array:
        return self._distance(data) <= NEAR


def _with_success(state: State, success: jax.Array) -> State:
    metrics = state.metrics | {"success": success}
    return state.replace(metrics=metrics)  # pyright: ignore[reportAttributeAccessIssue]
