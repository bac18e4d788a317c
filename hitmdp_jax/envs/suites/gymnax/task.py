"""A task of gymnax's interface, behind Brax's."""

import copy
import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env, State

from hitmdp_jax.envs.keywords import defaults_of
from hitmdp_jax.envs.spec import Action, Box, Discrete, Observation, Spec
from hitmdp_jax.envs.spec_task import SpecTask
from hitmdp_jax.envs.suites.base import with_keywords

LIMIT = "max_steps_in_episode"
# Observations whose numbers mean different things: the names of the numbers, and the parts.
SHOWN = {
    "FourRooms-misc": (
        ("row", "column", "goal row", "goal column"),
        (("place", (2,)), ("goal", (2,))),
    )
}

ACTION_NAMES = {  # where the library gives numbers alone
    "Catch-bsuite": ("left", "stay", "right"),
    "CartPole-v1": ("left", "right"),
    "FourRooms-misc": ("north", "east", "south", "west"),
    "MountainCar-v0": ("left", "coast", "right"),
}


class KeyedTask(SpecTask):
    """A task of gymnax's interface behind Brax's, one episode at a time.

    The library's own restart at the end of an episode is not used: this calls `reset_env` and
    `step_env`. The randomness of a step comes from a key in `state.info`. An observation that is
    one of n symbols becomes a row of n booleans, one of them true.

    Args:
      task: the library's task.
      params: its parameters.
      episode_length: the time limit in steps.
      action_names: of discrete actions; numbers where the library gives none.
      shown: the names of an observation's numbers, and its parts; one part otherwise.
    """

    def __init__(
        self,
        task: Any,
        params: Any,
        episode_length: int,
        action_names: tuple[str, ...] = (),
        shown: tuple[tuple[str, ...], tuple[tuple[str, tuple[int, ...]], ...]] = ((), ()),
    ):
        self.task, self.params, self.traced = task, params, numbers_of(task)
        self._symbols = getattr(task.observation_space(params), "n", None)
        obs: Any = jax.eval_shape(lambda key: self.start(key)[0], jax.random.key(0))
        names, parts = shown if obs.shape == (len(shown[0]),) else ((), ())
        observation = Observation(obs.shape, obs.dtype.name, names, parts)
        self.spec = Spec(
            observation, action_of(task.action_space(params), action_names), episode_length
        )

    def reset(self, rng: jax.Array) -> State:
        """Start an episode."""
        key, key_start = jax.random.split(rng)
        obs, state = self.start(key_start)
        zero = jnp.zeros((), jnp.float32)
        metrics = jax.tree.map(jnp.zeros_like, self.metrics(state, state))
        return State(state, obs, zero, zero, metrics, {"key": key, "truncation": zero})

    def step(self, state: State, action: jax.Array) -> State:
        """Advance one step under a choice [] or numbers [A]."""
        key, key_step = jax.random.split(state.info["key"])
        before: Any = state.pipeline_state
        obs, after, reward, terminated, _ = self.task.step_env(
            key_step, before, self.spec.action.clip(action), self.params
        )
        terminated = jnp.asarray(terminated, bool)
        truncated = self.truncated(after) & ~terminated
        return state.replace(  # pyright: ignore[reportAttributeAccessIssue]
            pipeline_state=after,
            obs=self.observation(obs),
            reward=jnp.asarray(reward, jnp.float32),
            done=(terminated | truncated).astype(jnp.float32),
            metrics=state.metrics | self.metrics(before, after),
            info=state.info | {"key": key, "truncation": truncated.astype(jnp.float32)},
        )

    def with_numbers(self, numbers: Mapping[str, jax.Array]) -> "KeyedTask":
        """Return the task with other parameters [], which may be traced (`envs.numbers`)."""
        changed = copy.copy(self)
        changed.params = self.params.replace(**numbers)
        return changed

    def start(self, key: jax.Array) -> tuple[jax.Array, Any]:
        """Return the first observation and the library's first state."""
        obs, state = self.task.reset_env(key, self.params)
        return self.observation(obs), state

    def observation(self, obs: Any) -> jax.Array:
        """Return the task's observation, given one of the library's."""
        if self._symbols is None:
            return jnp.asarray(obs)
        return jax.nn.one_hot(obs, self._symbols, dtype=bool)

    def truncated(self, state: Any) -> jax.Array:
        """Return whether the library's time limit has been reached."""
        return jnp.asarray(self.task.is_truncated(state, self.params), bool)

    def metrics(self, before: Any, after: Any) -> dict[str, jax.Array]:
        """Return the metrics of a step between two of the library's states."""
        return {}


def action_of(space: Any, names: tuple[str, ...] = ()) -> Action:
    """Return our word for a library's action space, `Discrete` or `Box` by its attributes."""
    if hasattr(space, "n"):
        return Discrete(int(space.n), names)
    low, high = (np.broadcast_to(x, space.shape).ravel() for x in (space.low, space.high))
    return Box(tuple(low.tolist()), tuple(high.tolist()))


def numbers_of(task: Any) -> tuple[str, ...]:
    """Return the parameters that are real numbers and are read in reset and step alone.

    The time limit and the limits of actions are part of the spec, so they are left out.
    """
    params = task.default_params

    def action(**changed: float) -> Action:
        return action_of(task.action_space(params.replace(**changed)))

    floats = {name: x for name, x in vars(params).items() if type(x) is float and name != LIMIT}
    return tuple(name for name, x in floats.items() if action(**{name: x + 1.0}) == action())


def constructor(name: str) -> Callable[..., Env]:
    """Return a function that makes a task, and whose signature lists its keywords.

    They are those of the task's class and the fields of its parameters, such as `fail_prob` of the
    four rooms.
    """
    from gymnax import make

    task, params = make(name)
    own = defaults_of(type(task))
    make_it = functools.partial(_made, name, tuple(own))
    return with_keywords(make_it, own | vars(params), numbers_of(task))


def _made(name: str, own: tuple[str, ...], **keywords: Any) -> Env:
    """Make a task; its class takes the keywords `own`, its parameters the others."""
    from gymnax import make

    from hitmdp_jax.envs.suites.gymnax.drawing import kind_of

    task, params = make(name, **{key: x for key, x in keywords.items() if key in own})
    params = params.replace(**{key: x for key, x in keywords.items() if key not in own})
    length, shown = int(getattr(params, LIMIT)), SHOWN.get(name, ((), ()))
    names = ACTION_NAMES.get(name, ())
    return kind_of(name, task, params)(task, params, length, names, shown)
