"""A task of MuJoCo Playground, whose interface is like Brax's."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import mujoco
from brax.envs.base import Env

from hitmdp_jax.envs.spec import Box, Spec, observation_of
from hitmdp_jax.envs.spec_task import SpecTask
from hitmdp_jax.envs.suites.base import with_keywords

OTHERS = ("action_repeat", "vision")  # settings of the library's own trainers


class PlaygroundTask(SpecTask):
    """A task of Playground's, whose states are like Brax's and are left as they are.

    Actions are numbers from -1 to 1, as the library's own trainers give them.

    Args:
      name: the library's name of the task.
      impl: the library's physics, "jax" or "warp"; None takes "jax" on a CPU and the library's
        default elsewhere.
      **settings: entries of the task's configuration, such as `episode_length=500`.
    """

    backend = "playground"  # pyright: ignore[reportAssignmentType]

    def __init__(self, name: str, impl: str | None = None, **settings: Any):
        from mujoco_playground import registry

        if impl is None and jax.default_backend() == "cpu":
            impl = "jax"
        overrides = settings if impl is None else settings | {"impl": impl}
        self.task: Any = registry.load(name, config_overrides=overrides)
        length = registry.get_default_config(name).episode_length
        self.episode_length = settings.get("episode_length", length)
        if name in registry.dm_control_suite.ALL_ENVS:  # which nothing but time ends
            self.shortest_episode = self.episode_length
        size = self.task.action_size
        self.spec = Spec(
            observation_of(jax.eval_shape(self.task.reset, jax.random.key(0)).obs),
            Box((-1.0,) * size, (1.0,) * size),
            self.episode_length,
            float(self.task.dt),
        )

    @property
    def model(self) -> mujoco.MjModel:
        """The model that the task steps."""
        return self.task.mj_model

    def reset(self, rng: jax.Array) -> Any:
        """Start an episode."""
        return self.task.reset(rng)

    def step(self, state: Any, action: jax.Array) -> Any:
        """Advance one control step under numbers [A]."""
        return self.task.step(state, self.spec.action.clip(action))


def constructor(name: str) -> Callable[..., Env]:
    """Return a function that makes a task, and whose signature lists its keywords."""
    from mujoco_playground import registry

    config = registry.get_default_config(name)
    settings = {key: x for key, x in config.items() if key not in OTHERS}
    return with_keywords(functools.partial(PlaygroundTask, name), settings | {"impl": None})
