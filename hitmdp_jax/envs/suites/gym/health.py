"""Health: what staying in the healthy ranges is worth, and whether leaving ends the episode."""

from typing import NamedTuple

import jax
import jax.numpy as jnp


class Health(NamedTuple):
    """The consequences of being healthy, in Gymnasium's two versions of them.

    Attributes:
      reward: reward of a healthy step.
      terminate: whether the episode ends at the first unhealthy step.
      version: "v5", or "v4", which pays the reward for the step that ends the episode too.
    """

    reward: float
    terminate: bool
    version: str

    def survive_reward(self, healthy: jax.Array) -> jax.Array:
        """Return the reward of a step whose last state is `healthy` or not."""
        pays_the_end = self.version == "v4" and self.terminate
        return self.reward * (healthy | pays_the_end).astype(jnp.float32)

    def ends(self, healthy: jax.Array) -> jax.Array:
        """Return whether the episode terminates in a state that is `healthy` or not."""
        return ~healthy & self.terminate


def within(values: jax.Array, interval: tuple[float, float]) -> jax.Array:
    """Return whether all values lie in the open interval (NaN lies in none)."""
    low, high = interval
    return ((low < values) & (values < high)).all()
