"""Decoders: from a state and an option to an action distribution or a value."""

import distrax
import flax.linen as nn
import jax
import jax.numpy as jnp

from hitmdp_jax.networks.mlp import MLP, orthogonal


class ActionDecoder(nn.Module):
    """The action policy P(a_t | s_t, o_t) = Normal(Dense(FFN([s, W[o]])), exp(log_std)) (Eq. 50).

    States and options broadcast as in `MLP`, so one call gives the policy of every option. Called
    with the observation alone it is an ordinary Gaussian policy.

    Attributes:
      action_size: A.
      sizes: widths of the FFN.
      activation: "relu" or "tanh".
      initial_log_std: every entry of log_std at the start; log_std depends on no input.
      head_gain: gain of the mean's layer.
    """

    action_size: int
    sizes: tuple[int, ...] = (64, 64)
    activation: str = "relu"
    initial_log_std: jax.Array | float = -0.5
    head_gain: float = 0.01

    @nn.compact
    def __call__(self, obs: jax.Array, *option: jax.Array) -> distrax.MultivariateNormalDiag:
        """Map `MLP`'s arguments to an unbounded distribution over actions [..., A]."""
        features = MLP(self.sizes, self.activation, name="body")(obs, *option)
        mean = nn.Dense(self.action_size, kernel_init=orthogonal(self.head_gain), name="mean")
        log_std = self.param(
            "log_std",
            nn.initializers.constant(self.initial_log_std),
            (self.action_size,),
            jnp.float32,
        )
        loc = mean(features)
        return distrax.MultivariateNormalDiag(loc, jnp.broadcast_to(jnp.exp(log_std), loc.shape))


class Critic(nn.Module):
    """A value: V[s] from the observation, or Q_O[s, o] from [s, o-bar] (App. G.1).

    The last layer's output is scaled and shifted by two numbers that no gradient changes
    (`learning.value_scale`).

    Attributes:
      sizes: widths of the FFN.
      activation: "relu" or "tanh".
    """

    sizes: tuple[int, ...] = (64, 64)
    activation: str = "relu"

    @nn.compact
    def __call__(self, obs: jax.Array, *option: jax.Array) -> jax.Array:
        """Map `MLP`'s arguments to values [...]."""
        features = MLP(self.sizes, self.activation, name="body")(obs, *option)
        value = nn.Dense(1, kernel_init=orthogonal(1.0), name="value")(features).squeeze(-1)
        shift = self.param("shift", nn.initializers.zeros, (), jnp.float32)
        scale = self.param("scale", nn.initializers.ones, (), jnp.float32)
        return jax.lax.stop_gradient(shift) + jax.lax.stop_gradient(scale) * value
