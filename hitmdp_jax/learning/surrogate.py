"""The clipped surrogate objective of PPO."""

import jax
import jax.numpy as jnp

from hitmdp_jax.metrics import Metrics


def clipped_surrogate(
    log_prob: jax.Array,
    old_log_prob: jax.Array,
    advantage: jax.Array,
    clip_eps: jax.Array | float,
    name: str,
) -> tuple[jax.Array, Metrics]:
    """Return PPO's objective, to be maximised (Schulman et al. 2017, Eq. 7), and diagnostics.

    Args:
      log_prob: [N] log-probability (density) of what was sampled, under the current policy.
      old_log_prob: [N] the same under the policy that sampled it.
      advantage: [N].
      clip_eps: half-width of the ratio's clipping interval.
      name: which policy it is, for the diagnostics' names.

    Returns:
      The mean objective, and `<name>_kl`: the mean of (ratio - 1) - log ratio, an unbiased
      non-negative estimate of KL(old || new) in nats (Schulman, "Approximating KL divergence");
      `<name>_clip_fraction`: the share of samples whose ratio left the interval.
    """
    log_ratio = log_prob - old_log_prob
    ratio = jnp.exp(log_ratio)
    clipped = jnp.clip(ratio, 1.0 - clip_eps, 1.0 + clip_eps)
    objective = jnp.minimum(ratio * advantage, clipped * advantage).mean()
    diagnostics = {
        f"{name}_kl": (ratio - 1.0 - log_ratio).mean(),
        f"{name}_clip_fraction": (jnp.abs(ratio - 1.0) > clip_eps).mean(),
    }
    return objective, diagnostics
