"""The network of the option baselines: per-option policies and terminations, a master, a critic."""

from typing import Any

import distrax
import flax.linen as nn
import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.networks.mlp import MLP, orthogonal

HEAD_GAIN = 1e-3  # small, so that options start alike, beta near 1/2 and the master near uniform


class OptionHeads(struct.PyTreeNode):
    """What the network says of states [..., O]."""

    mean: jax.Array  # [..., K, A] of each option's action policy, within +-1
    std: jax.Array  # [K, A] of each option's action policy, the same in every state
    termination: jax.Array  # [..., K] logits of beta_o(s), option o's probability to end in s
    log_master: jax.Array  # [..., K] log pi(o | s), the SMDP master policy over options
    value: jax.Array  # [..., V] the critic's outputs

    def policy(self, option: jax.Array) -> Any:
        """Return pi_o(a | s), a distribution over [..., A], of the options [...]."""
        one_hot = jax.nn.one_hot(option, self.std.shape[0], dtype=self.std.dtype)
        mean = (one_hot[..., None] * self.mean).sum(-2)  # fuses, unlike a gather and its gradient
        return distrax.MultivariateNormalDiag(mean, one_hot @ self.std)

    def every_policy(self) -> Any:
        """Return pi_o(a | s) of each option, a distribution over [..., K, A]."""
        std = jnp.broadcast_to(self.std, self.mean.shape)
        return distrax.MultivariateNormalDiag(self.mean, std)


class Head(nn.Module):
    """A body of its own and one linear layer."""

    size: int
    hidden_sizes: tuple[int, ...]
    activation: str

    @nn.compact
    def __call__(self, obs: jax.Array) -> jax.Array:
        """Map observations [..., O] to outputs [..., size]."""
        features = MLP(self.hidden_sizes, self.activation, gain=1.0, name="body")(obs)
        return nn.Dense(self.size, kernel_init=orthogonal(HEAD_GAIN), name="output")(features)


class OptionNetwork(nn.Module):
    """The network of the five option baselines (Zhang & Whiteson 2019, their public code).

    Nothing is shared: each option has a policy body and a termination body, the master and the
    critic have one each. The bodies of the K options are one vmapped body, so an evaluation is a
    few batched products, not K small networks. An action policy is Normal(tanh(.), softplus(rho)).

    Attributes:
      action_size: A.
      num_options: K.
      num_values: V, outputs of the critic: K for Q[s, o], K + 1 for AHP's V[s, o_{t-1}].
      hidden_sizes: widths of each body.
      activation: "relu" or "tanh".
    """

    action_size: int
    num_options: int
    num_values: int
    hidden_sizes: tuple[int, ...]
    activation: str

    @nn.compact
    def __call__(self, obs: jax.Array) -> OptionHeads:
        """Evaluate every head in states obs [..., O]; under jit, unused ones cost nothing."""
        body = self.hidden_sizes, self.activation
        each = nn.vmap(
            Head,
            variable_axes={"params": 0},
            split_rngs={"params": True},
            in_axes=None,  # pyright: ignore[reportArgumentType]
            out_axes=-2,
            axis_size=self.num_options,
        )
        mean = jnp.tanh(each(self.action_size, *body, name="policies")(obs))
        shape = self.num_options, self.action_size
        rho = self.param("rho", nn.initializers.zeros, shape, jnp.float32)
        termination = each(1, *body, name="terminations")(obs).squeeze(-1)
        master = Head(self.num_options, *body, name="master")(obs)
        value = Head(self.num_values, *body, name="critic")(obs)
        return OptionHeads(
            mean, jax.nn.softplus(rho), termination, jax.nn.log_softmax(master), value
        )
