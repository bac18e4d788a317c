"""AHP: the Augmented Hierarchical Policy (Levy & Shimkin 2011), optimised by PPO."""

from typing import Any, ClassVar

import distrax
import jax
import jax.numpy as jnp

from hitmdp_jax.agents.option_agent import ClippedOptionAgent
from hitmdp_jax.learning.options import OptionMemory, at_option, drawn_option, entropy
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks import OptionHeads


class AHP(ClippedOptionAgent):
    """Learns options as one policy over one augmented MDP.

    States (s_t, o_{t-1}), actions (b_t, o_t, a_t): whether to stop, which option, which action.

        P(b, o, a | s, o_{t-1}) = beta_{o_{t-1}}(s) pi(o | s) pi_o(a | s)          if b = 1
                                  (1 - beta_{o_{t-1}}(s)) 1[o = o_{t-1}] pi_o(a | s) if b = 0

    An episode's first step chooses anew for certain, so beta is no factor there. One clipped
    surrogate holds the ratio of all three together, with one advantage over V[s, o_{t-1}], which is
    a head of the critic for each previous option and one for none. There is no entropy bonus.

    Against DAC and MOPG: one ratio and one advantage instead of two, and V is learnt itself, not
    made of Q; that b_t was drawn enters, although only o_t shows.

    The record is (o_t, b_t).
    """

    followed: ClassVar[tuple[str, ...]] = ("joint_kl",)

    @property
    def num_values(self) -> int:
        """Return the number of the critic's outputs: V[s, o_{t-1}], and V at an episode's start."""
        return self.num_options + 1

    def choose(
        self, heads: OptionHeads, memory: OptionMemory, key: jax.Array, deterministic: bool
    ) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        """Draw the stop b_t, and o_t if it stops; return o_t and the record."""
        key_stop, key_option = jax.random.split(key)
        stops: Any = distrax.Bernoulli(at_option(heads.termination, memory.previous), dtype=bool)
        stop = stops.mode() if deterministic else stops.sample(seed=key_stop)
        stop = stop | memory.initial
        chosen = drawn_option(heads.log_master, key_option, deterministic)
        option = jnp.where(stop, chosen, memory.previous)
        return option, (option, stop)

    def log_prob(self, heads: OptionHeads, data: dict[str, Any]) -> jax.Array:
        """Return log P(b_t, o_t, a_t | s_t, o_{t-1}) [...]."""
        memory, option, stop = data["memory"], data["option"], data["stop"]
        termination = at_option(heads.termination, memory.previous)
        log_stop = jax.nn.log_sigmoid(jnp.where(stop, termination, -termination))
        log_stop = jnp.where(memory.initial, 0.0, log_stop)
        log_option = jnp.where(stop, at_option(heads.log_master, option), 0.0)
        return log_stop + log_option + heads.policy(option).log_prob(data["action"])

    def value(self, heads: OptionHeads, memory: OptionMemory) -> jax.Array:
        """Return V[s_t, o_{t-1}], of shape [...]: the last output where an episode starts."""
        return at_option(heads.value, jnp.where(memory.initial, self.num_options, memory.previous))

    def value_of(self, params: Any, obs: jax.Array, memory: OptionMemory) -> jax.Array:
        """Return V[s, o_{t-1}], of shape [...]."""
        return self.value(self.heads(params, obs), memory)

    def option_of(self, record: tuple[jax.Array, jax.Array]) -> jax.Array:
        """Return the options that were executed."""
        return record[0]

    def targets(self, params: Any, batch: Batch) -> tuple[dict[str, Any], Metrics]:
        """Evaluate a rollout into what the loss reads, [T, B, ...], and metrics."""
        option, stop = batch.record
        heads, heads_next = self.heads(params, batch.obs), self.heads(params, batch.next_obs)
        under_way = OptionMemory(option, jnp.zeros_like(batch.memory.initial))
        value = self.value(heads, batch.memory)
        data = {
            "obs": batch.obs,
            "memory": batch.memory,
            "option": option,
            "stop": stop,
            "action": batch.action,
        }
        data["log_prob"] = self.log_prob(heads, data)
        data["advantage"], data["value_target"] = self.advantage_and_return(
            batch, value, self.value(heads_next, under_way)
        )
        metrics = {
            "master_entropy": entropy(heads.log_master).mean(),
            "action_entropy": heads.policy(option).entropy().mean(),
            "value": value.mean(),
        }
        return data, metrics | self.statistics(params, batch, option)

    def loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return the loss of a minibatch: the surrogate and the critic's squared error."""
        heads = self.heads(params, data["obs"])
        surrogate, metrics = self.surrogate(
            "joint", self.log_prob(heads, data), data["log_prob"], data["advantage"]
        )
        value = self.value(heads, data["memory"])
        value_loss = 0.5 * jnp.square(value - data["value_target"]).mean()
        loss = self.in_units(params, value_loss) - surrogate
        return loss, metrics | {"value_loss": value_loss}
