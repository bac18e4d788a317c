"""What whole episodes came to, in a rollout and over the last ones."""

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.envs.vector import Step
from hitmdp_jax.metrics import Metrics, describe

RECENT_EPISODES = 100  # what `recent_return` averages over


class EpisodeWindow(struct.PyTreeNode):
    """The last whole episodes of one seed."""

    returns: jax.Array  # [RECENT_EPISODES] a ring, undiscounted
    lengths: jax.Array  # [RECENT_EPISODES] control steps
    count: jax.Array  # int32, episodes ever

    @classmethod
    def empty(cls) -> "EpisodeWindow":
        """Return the window of a seed that has finished no episode."""
        zeros = jnp.zeros(RECENT_EPISODES, jnp.float32)
        return cls(zeros, zeros, jnp.zeros((), jnp.int32))

    def add(self, outcome: Step) -> "EpisodeWindow":
        """Return the window after the episodes that ended in a rollout [T, B]."""
        finished = outcome.finished.ravel()
        number = self.count + jnp.cumsum(finished)  # 1, 2, ... of each episode that ended
        total = number[-1]
        kept = finished & (number > total - RECENT_EPISODES)
        slot = jnp.where(kept, (number - 1) % RECENT_EPISODES, RECENT_EPISODES)
        return EpisodeWindow(
            self.returns.at[slot].set(outcome.episode_return.ravel(), mode="drop"),
            self.lengths.at[slot].set(outcome.episode_length.ravel(), mode="drop"),
            total.astype(jnp.int32),
        )

    def metrics(self) -> Metrics:
        """Return the means over the window; NaN before the first episode has ended."""
        known = jnp.minimum(self.count, RECENT_EPISODES)
        return {
            "recent_return": self.returns.sum() / known,
            "recent_length": self.lengths.sum() / known,
        }


def episode_metrics(outcome: Step) -> Metrics:
    """Return the means over whole episodes that ended in a rollout; NaN where none did.

    `step_reward` is the mean over all steps of it, and so known before an episode has ended.
    `episode_return` is undiscounted and raw, of the stochastic training policy. What a task reports
    of its steps is their mean; what it reports of an episode (`metrics`), such as success,
    is read at the episode's end.
    """
    count = outcome.finished.sum()

    def mean(x: jax.Array) -> jax.Array:
        total = jnp.where(outcome.finished, x, 0).sum()
        return jnp.where(count > 0, total / jnp.maximum(count, 1), jnp.nan)

    return {
        "episode_return": mean(outcome.episode_return),
        "episode_length": mean(outcome.episode_length),
        "episodes": count,
        "step_reward": outcome.reward.mean(),
    } | {
        name: mean(x) if describe(name).over_iterations == "by episodes" else x.mean()
        for name, x in outcome.metrics.items()
    }
