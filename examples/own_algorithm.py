"""An algorithm of one's own in one file: MOPG whose ratios may grow further than they may shrink.

The clipping interval is [1 - clip_eps, 1 + clip_high], as in DAPO (Yu et al. 2025, Eq. 10).

    python train.py algo=examples/own_algorithm.py:ClipHigher algo.clip_high=0.3
"""

import jax
import jax.numpy as jnp

from hitmdp_jax.agents import MOPG, traced
from hitmdp_jax.metrics import Metrics


class ClipHigher(MOPG):
    """MOPG with an asymmetric clipping interval, for both policies."""

    clip_high: float = traced(0.28)  # a float is swept, and annealed, like any other

    def surrogate(
        self, name: str, log_prob: jax.Array, old_log_prob: jax.Array, advantage: jax.Array
    ) -> tuple[jax.Array, Metrics]:
        """Return the objective of one policy, to be maximised, and diagnostics of that name."""
        _, measured = super().surrogate(name, log_prob, old_log_prob, advantage)
        ratio = jnp.exp(log_prob - old_log_prob)
        clipped = jnp.clip(ratio, 1.0 - self.clip_eps, 1.0 + self.clip_high)
        objective = jnp.minimum(ratio * advantage, clipped * advantage).mean()
        # Its KL among them, which the learning rate follows.
        return objective, measured | {f"{name}_clip_fraction": (ratio != clipped).mean()}
