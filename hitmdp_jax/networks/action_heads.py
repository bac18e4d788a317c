"""Action heads: from features to a distribution over a task's actions, and what it shows."""

from typing import Any

import distrax
import flax.linen as nn
import jax
import jax.numpy as jnp

from hitmdp_jax.envs.spec import Action, Discrete
from hitmdp_jax.networks.mlp import orthogonal


class Gaussian(nn.Module):
    """Normal(Dense(features), exp(log_std)), over unbounded actions [..., A].

    Attributes:
      size: A.
      initial_log_std: every entry of log_std at the start; log_std depends on no input.
      gain: of the mean's layer.
    """

    size: int
    initial_log_std: jax.Array | float
    gain: float

    @nn.compact
    def __call__(self, features: jax.Array) -> Any:
        """Map features [..., H] to a distribution."""
        mean = nn.Dense(self.size, kernel_init=orthogonal(self.gain), name="mean")(features)
        initial = nn.initializers.constant(self.initial_log_std)
        log_std = self.param("log_std", initial, (self.size,), jnp.float32)
        return distribution(mean, jnp.exp(log_std))


class Categorical(nn.Module):
    """Softmax(Dense(features)), over n choices.

    Attributes:
      size: n.
      gain: of the logits' layer; small makes the first policy nearly uniform.
    """

    size: int
    gain: float

    @nn.compact
    def __call__(self, features: jax.Array) -> Any:
        """Map features [..., H] to a distribution."""
        head = nn.Dense(self.size, kernel_init=orthogonal(self.gain), name="logits")
        return distribution(head(features))


def action_head(action: Action, initial_log_std: jax.Array | float, gain: float) -> nn.Module:
    """Return the head for a task's actions; choices have no standard deviation."""
    if isinstance(action, Discrete):
        return Categorical(action.n, gain)
    return Gaussian(action.size, initial_log_std, gain)


def distribution(vector: jax.Array, std: jax.Array | None = None) -> Any:
    """Return a Gaussian of its means [..., A], or a choice of its logits [..., n]."""
    if std is None:
        return distrax.Categorical(vector)
    return distrax.MultivariateNormalDiag(vector, jnp.broadcast_to(std, vector.shape))


def log_prob_of_each(policies: Any, action: jax.Array) -> jax.Array:
    """Return log P(a | o) [..., K] of actions under policies over [..., K]."""
    return policies.log_prob(jnp.expand_dims(action, action.ndim - len(policies.event_shape)))


def vector_of(policy: Any) -> Any:
    """Return the one vector that tells what a policy does: the mean, or of choices log P(a)."""
    return policy.logits if isinstance(policy, distrax.Categorical) else policy.mean()


def noise_of(policy: Any) -> jax.Array:
    """Return by how much of `vector_of` a policy is noticeably another: std, or of choices 1."""
    if isinstance(policy, distrax.Categorical):
        return jnp.ones_like(policy.logits)
    return policy.stddev()
