"""Critics that learn at one pace whatever a task's returns amount to, and stay near them."""

from typing import Any

import jax
import jax.numpy as jnp

RATE = 0.1  # the share of a rollout in the running moments
SMALLEST = 1e-2  # a scale: what a constant target would be divided by


def decay(critic: Any, share: jax.Array | float) -> Any:
    """Move all values by a share of their distance to the targets' running mean, towards it.

    A critic bootstraps from its own values where a time limit ends an episode, and what it gets
    wrong there, in a state that no reward corrects, is in the targets of the whole episode. With
    short episodes and goals that are new in each, nothing holds such errors: they feed themselves,
    the scale grows with them, and the advantages drown (results/notebook.md). The fit that follows
    makes up for the decay wherever it has data.

    Args:
      critic: the parameters of `networks.Critic`.
      share: from 0 to 1.

    Returns:
      The new parameters.
    """
    return critic | {"value": jax.tree.map(lambda x: (1.0 - share) * x, critic["value"])}


def rescale(critic: Any, target: jax.Array) -> Any:
    """Fit a critic's shift and scale to its targets, without changing any value (PopArt).

    The last layer takes up the difference (van Hasselt et al. 2016, "Learning values across many
    orders of magnitude", Prop. 1). Where the scale is not that of the returns, the critic's
    gradient is most of the norm that is clipped, and Adam's epsilon most of what the policies'
    gradients are divided by.

    Args:
      critic: the parameters of `networks.Critic`.
      target: [...] what the values are about to be fitted to.

    Returns:
      The new parameters.
    """
    shift, scale, last = critic["shift"], critic["scale"], critic["value"]
    # The running square less that of the running mean, without the difference of two large numbers.
    distance = target.mean() - shift
    new_shift = shift + RATE * distance
    kept = jnp.square(scale) + RATE * jnp.square(distance)
    new_variance = (1.0 - RATE) * kept + RATE * target.var()
    new_scale = jnp.sqrt(jnp.maximum(new_variance, SMALLEST**2))
    ratio = scale / new_scale
    value = {
        "kernel": last["kernel"] * ratio,
        "bias": last["bias"] * ratio + (shift - new_shift) / new_scale,
    }
    return critic | {"value": value, "shift": new_shift, "scale": new_scale}
