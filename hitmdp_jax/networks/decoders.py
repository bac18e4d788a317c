"""Decoders: from a state and an option to an action distribution or a value."""

from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp

from hitmdp_jax.envs.spec import Action
from hitmdp_jax.networks.action_heads import action_head
from hitmdp_jax.networks.mlp import MLP, orthogonal


class ActionDecoder(nn.Module):
    """The action policy P(a_t | s_t, o_t) = head(FFN([s, W[o]])) (Eq. 50).

    States and options broadcast as in `MLP`, so one call gives the policy of every option. Called
    with the observation alone it is an ordinary policy.

    Attributes:
      actions: the task's actions.
      sizes: widths of the FFN.
      activation: a name of `mlp.ACTIVATIONS`.
      initial_log_std: as `action_heads.Gaussian`.
      head_gain: gain of the head's layer.
    """

    actions: Action
    sizes: tuple[int, ...] = (64, 64)
    activation: str = "relu"
    initial_log_std: jax.Array | float = -0.5
    head_gain: float = 0.01

    def setup(self):
        """Declare the parts; the head's parameters lie beside the body's."""
        self.body = MLP(self.sizes, self.activation)
        self.head = action_head(self.actions, self.initial_log_std, self.head_gain)
        nn.share_scope(self, self.head)

    def __call__(self, obs: jax.Array, *option: jax.Array) -> Any:
        """Map `MLP`'s arguments to a distribution over actions."""
        return self.head(self.body(obs, *option))


class Critic(nn.Module):
    """A value: V[s] from the observation, or Q_O[s, o] from [s, o-bar] (App. G.1).

    The last layer's output is scaled and shifted by two numbers that no gradient changes
    (`learning.value_scale`).

    Attributes:
      sizes: widths of the FFN.
      activation: a name of `mlp.ACTIVATIONS`.
    """

    sizes: tuple[int, ...] = (64, 64)
    activation: str = "relu"

    @nn.compact
    def __call__(self, obs: jax.Array, *option: jax.Array) -> jax.Array:
        """Map `MLP`'s arguments to values [...]."""
        features = MLP(self.sizes, self.activation, name="body")(obs, *option)
        value = nn.Dense(1, kernel_init=orthogonal(1.0), name="value")(features).squeeze(-1)
        return in_units_of_its_own(self, value)


def in_units_of_its_own(critic: nn.Module, value: jax.Array) -> jax.Array:
    """Return a critic's values, of which its last layer, "value", says how many units they are."""
    shift = critic.param("shift", nn.initializers.zeros, (), jnp.float32)
    scale = critic.param("scale", nn.initializers.ones, (), jnp.float32)
    return jax.lax.stop_gradient(shift) + jax.lax.stop_gradient(scale) * value


class ActionCritic(nn.Module):
    """A value of actions: Q[s, a], or Q[s, o, a] from [s, a, W[o]].

    Attributes:
      sizes: widths of the FFN.
      activation: a name of `mlp.ACTIVATIONS`.
      layer_norm: as `mlp.MLP`.
    """

    sizes: tuple[int, ...] = (256, 256)
    activation: str = "relu"
    layer_norm: bool = False

    @nn.compact
    def __call__(self, obs: jax.Array, action: jax.Array, *option: jax.Array) -> jax.Array:
        """Map observations [..., O], actions [..., A] and `MLP`'s options to values [...]."""
        body = MLP(self.sizes, self.activation, layer_norm=self.layer_norm, name="body")
        features = body(obs, *option, action=action)
        return nn.Dense(1, kernel_init=orthogonal(1.0), name="value")(features).squeeze(-1)
