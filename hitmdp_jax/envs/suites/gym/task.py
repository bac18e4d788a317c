"""What Gymnasium's tasks share: keywords that are fields, rewards that are sums, and health."""

import abc
import dataclasses
import functools
import operator

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

Terms = dict[str, jax.Array]


@dataclasses.dataclass(eq=False, repr=False)
class GymTask(MujocoEnv):
    """A task of Gymnasium's in its two versions; a subclass adds its keywords as fields.

    `__post_init__(physics)` of the subclass makes the model and calls `MujocoEnv.__init__`,
    which `super()` does not reach.

    Args:
      physics: the engine; see `MujocoEnv`.
      version: "v5" or "v4", Gymnasium's semantics of that name.
    """

    physics: dataclasses.InitVar[PhysicsChoice] = "mjx"  # pyright: ignore
    version: str = "v5"

    @abc.abstractmethod
    def terms(self, before: PhysicsState, after: PhysicsState, action: jax.Array) -> Terms:
        """Return the terms of a step's reward, in the order in which they are added up."""

    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, Terms]:
        """Return the sum of the terms."""
        terms = self.terms(before, after, action)
        return functools.reduce(operator.add, terms.values()), terms


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class HealthyTask(GymTask):
    """A task that pays for staying healthy, and whose episode ends where that ends.

    Version 4 pays for the step that ends the episode, too.

    Args:
      healthy_reward: reward of a healthy step.
      terminate_when_unhealthy: whether the episode ends at the first unhealthy step.
    """

    healthy_reward: float = 1.0
    terminate_when_unhealthy: bool = True

    @abc.abstractmethod
    def healthy(self, data: PhysicsState) -> jax.Array:
        """Return whether the body lies inside its healthy ranges."""

    def survive_reward(self, data: PhysicsState) -> jax.Array:
        """Return the reward of a step that ends in a state."""
        pays_the_end = self.version == "v4" and self.terminate_when_unhealthy
        return self.healthy_reward * (self.healthy(data) | pays_the_end).astype(jnp.float32)

    def terminated(self, data: PhysicsState) -> jax.Array:
        """Return whether the body became unhealthy."""
        return ~self.healthy(data) & self.terminate_when_unhealthy


def within(values: jax.Array, interval: tuple[float, float]) -> jax.Array:
    """Return whether all values lie in the open interval (NaN lies in none)."""
    low, high = interval
    return ((low < values) & (values < high)).all()
