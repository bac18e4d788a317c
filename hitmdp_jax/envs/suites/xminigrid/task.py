"""A task of XLand-MiniGrid, behind Brax's interface."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env, State

from hitmdp_jax.envs.spec import Discrete, Observation, Spec
from hitmdp_jax.envs.spec_task import SpecTask

ACTIONS = ("forward", "turn right", "turn left", "pick up", "put down", "toggle")


class MiniGridTask(SpecTask):
    """A grid that is seen as the agent sees it, behind Brax's interface.

    The observation [V, V, tiles + colours] is one-hot: of each square in view its tile, then its
    colour. It is of booleans, which a rollout keeps in a quarter of what floats would take. The
    reward is 1 - 0.9 t / limit at the goal, which ends the episode, and 0 before.

    Args:
      name: the library's name of the task.
      view_size: V, squares in view on a side; odd.
      max_steps: the time limit in steps; None takes the task's own.
    """

    def __init__(self, name: str, view_size: int = 7, max_steps: int | None = None):
        from xminigrid.core.constants import NUM_COLORS, NUM_TILES
        from xminigrid.registration import make

        self.task, params = make(name)
        limit = int(max_steps or params.max_steps or 0)
        self.params = params.replace(view_size=view_size, max_steps=limit)
        self._kinds = NUM_TILES, NUM_COLORS
        observation = Observation((view_size, view_size, sum(self._kinds)))
        self.spec = Spec(observation, Discrete(len(ACTIONS), ACTIONS), limit)

    def reset(self, rng: jax.Array) -> State:
        """Start an episode."""
        first: Any = self.task.reset(self.params, rng)
        zero = jnp.zeros((), jnp.float32)
        info = {"truncation": zero}
        return State(first, self._observation(first), zero, zero, {"success": zero}, info)

    def step(self, state: State, action: jax.Array) -> State:
        """Advance one step under one of `ACTIONS`."""
        before: Any = state.pipeline_state
        now = self.task.step(self.params, before, action)
        reached = (now.discount == 0.0).astype(jnp.float32)
        ended = now.last().astype(jnp.float32)
        return state.replace(  # pyright: ignore[reportAttributeAccessIssue]
            pipeline_state=now,
            obs=self._observation(now),
            reward=jnp.asarray(now.reward, jnp.float32),
            done=ended,
            metrics=state.metrics | {"success": reached},
            info=state.info | {"truncation": ended * (1.0 - reached)},
        )

    def draw(self, state: State) -> np.ndarray:
        """Return the library's picture [H, W, 3] of a state: the squares in view are lighter."""
        from xminigrid.rendering.rgb_render import render

        now: Any = state.pipeline_state
        return render(np.asarray(now.state.grid), now.state.agent, self.params.view_size)

    def _observation(self, now: Any) -> jax.Array:
        tiles, colours = (
            jax.nn.one_hot(now.observation[..., layer], kinds, dtype=bool)
            for layer, kinds in enumerate(self._kinds)
        )
        return jnp.concatenate([tiles, colours], axis=-1)


def constructor(name: str) -> Callable[..., Env]:
    """Return a function that makes a task."""
    return functools.partial(MiniGridTask, name)
