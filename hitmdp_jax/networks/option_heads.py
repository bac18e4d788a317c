"""The network of the option baselines: per-option policies and terminations, a master, a critic."""

from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.envs.spec import Action, Box
from hitmdp_jax.networks.action_heads import distribution
from hitmdp_jax.networks.decoders import in_units_of_its_own
from hitmdp_jax.networks.mlp import MLP, orthogonal
from hitmdp_jax.networks.reads import Reads, read

HEAD_GAIN = 1e-3  # small, so that options start alike, beta near 1/2 and the master near uniform


class OptionHeads(struct.PyTreeNode):
    """What the network says of states [..., O]."""

    action: jax.Array  # [..., K, A] each option's mean action, within +-1; or of n choices, logits
    std: jax.Array | None  # [K, A] of its actions, the same in every state; None of choices
    termination: jax.Array  # [..., K] logits of beta_o(s), option o's probability to end in s
    log_master: jax.Array  # [..., K] log pi(o | s), the SMDP master policy over options
    value: jax.Array  # [..., V] the critic's outputs

    def policy(self, option: jax.Array) -> Any:
        """Return pi_o(a | s), a distribution, of the options [...]."""
        one_hot = jax.nn.one_hot(option, self.action.shape[-2], dtype=self.action.dtype)
        chosen = (one_hot[..., None] * self.action).sum(-2)  # fuses, unlike a gather's gradient
        return distribution(chosen, None if self.std is None else one_hot @ self.std)

    def every_policy(self) -> Any:
        """Return pi_o(a | s) of each option, a distribution over [..., K]."""
        return distribution(self.action, self.std)


class Head(nn.Module):
    """A body of its own and one linear layer, `scaled` as that of `networks.Critic`."""

    size: int
    hidden_sizes: tuple[int, ...]
    activation: str
    scaled: bool = False

    @nn.compact
    def __call__(self, obs: jax.Array) -> jax.Array:
        """Map observations [..., O] to outputs [..., size]."""
        features = MLP(self.hidden_sizes, self.activation, gain=1.0, name="body")(obs)
        name = "value" if self.scaled else "output"
        output = nn.Dense(self.size, kernel_init=orthogonal(HEAD_GAIN), name=name)(features)
        return in_units_of_its_own(self, output) if self.scaled else output


class OptionNetwork(nn.Module):
    """The network of the five option baselines (Zhang & Whiteson 2019, their public code).

    Nothing is shared: each option has a policy body and a termination body, the master and the
    critic have one each. The bodies of the K options are one vmapped body, so an evaluation is a
    few batched products, not K small networks. An action policy is Normal(tanh(.), softplus(rho)),
    or softmax(.) over choices.

    Attributes:
      actions: the task's actions.
      num_options: K.
      num_values: V, outputs of the critic: K for Q[s, o], K + 1 for AHP's V[s, o_{t-1}].
      hidden_sizes: widths of each body.
      activation: a name of `mlp.ACTIVATIONS`.
      reads: what of the observation; the terminations read what the master does.
      scaled: whether the critic has units of its own (`learning.value_scale`).
    """

    actions: Action
    num_options: int
    num_values: int
    hidden_sizes: tuple[int, ...]
    activation: str
    reads: Reads = Reads()
    scaled: bool = False

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
        reads = self.reads.action, self.reads.master, self.reads.critic
        acting, choosing, judging = (read(obs, entries) for entries in reads)
        action, std = each(self.actions.size, *body, name="policies")(acting), None
        if isinstance(self.actions, Box):
            shape = self.num_options, self.actions.size
            rho = self.param("rho", nn.initializers.zeros, shape, jnp.float32)
            action, std = jnp.tanh(action), jax.nn.softplus(rho)
        termination = each(1, *body, name="terminations")(choosing).squeeze(-1)
        master = Head(self.num_options, *body, name="master")(choosing)
        value = Head(self.num_values, *body, self.scaled, name="critic")(judging)
        return OptionHeads(action, std, termination, jax.nn.log_softmax(master), value)
