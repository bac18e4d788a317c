"""What the five option baselines share: the network, the memory and how an option is drawn."""

import math
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.agents.base import static, traced
from hitmdp_jax.agents.gradient_agent import ClippedAgent, ClippedState, GradientAgent
from hitmdp_jax.learning.advantages import standardize
from hitmdp_jax.learning.optimization import adapted_share
from hitmdp_jax.learning.options import (
    OptionMemory,
    at_option,
    drawn_option,
    entropy,
    expected_value,
    option_statistics,
    option_transition,
    value_of_next_option,
)
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks import OptionHeads, OptionNetwork
from hitmdp_jax.networks.mlp import ACTIVATIONS
from hitmdp_jax.precision import in_32_bits


class OptionValues(struct.PyTreeNode):
    """The values of a rollout in the two augmented MDPs; `next` is in the states reached."""

    value: jax.Array  # [T, B] V[s_t, o_{t-1}] = sum_o P(o | s_t, o_{t-1}) Q[s_t, o]
    value_next: jax.Array  # [T, B] V[s_{t+1}, o_t]
    q: jax.Array  # [T, B] Q[s_t, o_t]
    q_next: jax.Array  # [T, B] Q[s_{t+1}, o_{t+1}]; V[s_{t+1}, o_t] where o_{t+1} was not drawn


class OptionAgent(GradientAgent):
    """An agent that calls an option, follows it until it terminates, and calls the next.

    Memory: the previous option o_{t-1} and whether the episode starts, `OptionMemory`. The record
    is o_t.
    """

    num_options: int = static(4)
    activation: str = static("tanh", tuple(ACTIVATIONS))
    master_reads: tuple[str, ...] = static((), of=str)  # and the terminations

    @property
    def num_values(self) -> int:
        """Return the number of the critic's outputs: Q[s, o] of each option."""
        return self.num_options

    @property
    def scaled(self) -> bool:
        """Return whether the critic has units of its own."""
        return False

    def network(self) -> OptionNetwork:
        """Return the network for the task's actions."""
        return OptionNetwork(
            self.actions,
            self.num_options,
            self.num_values,
            self.hidden_sizes,
            self.activation,
            self.reads,
            self.scaled,
        )

    def heads(self, params: Any, obs: jax.Array) -> OptionHeads:
        """Return the policies, the terminations, the master and the values in states [..., O]."""
        network: Any = self.network()
        return network.apply({"params": params}, obs)

    def policy(self, params: Any, obs: jax.Array, option: jax.Array) -> Any:
        """Return pi_o(a | s), a distribution, for obs [..., O], option [...]."""
        return self.heads(params, obs).policy(option)

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> Any:
        """Return the memory of an episode's start: no option is under way."""
        return OptionMemory(jnp.zeros(batch_shape, jnp.int32), jnp.ones(batch_shape, bool))

    def option_log_probs(self, heads: OptionHeads, memory: OptionMemory) -> jax.Array:
        """Return log P(o_t | s_t, o_{t-1}) [..., K]; the master's own where an episode starts."""
        termination = at_option(heads.termination, memory.previous)
        going_on = option_transition(heads.log_master, termination, memory.previous)
        return jnp.where(memory.initial[..., None], heads.log_master, going_on)

    def choose(
        self, heads: OptionHeads, memory: Any, key: jax.Array, deterministic: bool
    ) -> tuple[jax.Array, Any]:
        """Draw o_t [...], or take the likeliest; return it and the record."""
        option = drawn_option(self.option_log_probs(heads, memory), key, deterministic)
        return option, option

    def act(
        self, params: Any, obs: jax.Array, memory: Any, key: jax.Array, deterministic: bool = False
    ) -> tuple[jax.Array, Any, Any]:
        """Choose o_t, then a_t; the deterministic policy takes the likeliest of each."""
        key_option, key_action = jax.random.split(key)
        heads = self.heads(params, obs)
        option, record = self.choose(heads, memory, key_option, deterministic)
        policy = heads.policy(option)
        action = policy.mode() if deterministic else policy.sample(seed=key_action)
        return action, OptionMemory(option, jnp.zeros_like(memory.initial)), record

    def option_of(self, record: Any) -> jax.Array:
        """Return the options that were executed."""
        return record

    def value_of(self, params: Any, obs: jax.Array, memory: Any) -> jax.Array:
        """Return V[s, o_{t-1}] = sum_o P(o | s, o_{t-1}) Q[s, o], of shape [...]."""
        heads = self.heads(params, obs)
        return expected_value(self.option_log_probs(heads, memory), heads.value)

    def option_probs(self, params: Any, obs: jax.Array, memory: Any) -> jax.Array:
        """Return P(o_t | s_t, o_{t-1}) [..., K]."""
        return jnp.exp(self.option_log_probs(self.heads(params, obs), memory))

    def values(self, params: Any, batch: Batch) -> OptionValues:
        """Return the values of a rollout whose critic is Q[s, o]."""
        heads, heads_next = self.heads(params, batch.obs), self.heads(params, batch.next_obs)
        option = batch.record
        under_way = OptionMemory(option, jnp.zeros_like(batch.memory.initial))
        log_option = self.option_log_probs(heads, batch.memory)
        log_option_next = self.option_log_probs(heads_next, under_way)
        ended = batch.terminated | batch.truncated
        return OptionValues(
            value=expected_value(log_option, heads.value),
            value_next=expected_value(log_option_next, heads_next.value),
            q=at_option(heads.value, option),
            q_next=value_of_next_option(heads_next.value, log_option_next, option, ended),
        )

    def targets(self, params: Any, batch: Batch) -> tuple[dict[str, Any], Metrics]:
        """Evaluate a rollout into what the loss reads of both policies, [T, B, ...], and metrics.

        What the critic is fitted to is each algorithm's own.
        """
        # The heads again, and in `values`: the compiler makes one evaluation of equal ones.
        heads, option = self.heads(params, batch.obs), batch.record
        log_option, policy = self.option_log_probs(heads, batch.memory), heads.policy(option)
        data = {
            "obs": batch.obs,
            "memory": batch.memory,
            "option": option,
            "action": batch.action,
            "log_option": log_option,  # [T, B, K]
            "log_prob_action": policy.log_prob(batch.action),
        }
        metrics = {
            "option_entropy": entropy(log_option).mean(),
            "action_entropy": policy.entropy().mean(),
            "value": self.values(params, batch).value.mean(),
        }
        return data, metrics | self.statistics(params, batch, option)

    def statistics(self, params: Any, batch: Batch, option: jax.Array) -> Metrics:
        """Return the options' [T, B] probability to end, steps and activations in a rollout."""
        termination = at_option(self.heads(params, batch.next_obs).termination, option)
        counts = option_statistics(option, batch.memory.previous, batch.started, self.num_options)
        return counts | {"termination": jax.nn.sigmoid(termination).mean()}


class ClippedOptionAgent(OptionAgent, ClippedAgent):
    """An option agent whose policies PPO optimises.

    An algorithm is its `targets` and its `loss`, or an `update` of its own. No paper of these
    algorithms adapts the steps to the task as our MOPG and PPO do, so that is off by default.
    """

    target_kl: float = traced(math.inf, infinite=True)
    normalize_values: bool = static(False)
    followed: ClassVar[tuple[str, ...]] = ("option_kl", "action_kl")  # by the learning rate

    @property
    def scaled(self) -> bool:
        """Return whether the critic has units of its own."""
        return self.normalize_values

    def loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return the loss of a minibatch [N, ...], and metrics."""
        raise NotImplementedError("an algorithm has a `loss`, or an `update` that needs none")

    def update(
        self, state: ClippedState, batch: Batch, key: jax.Array
    ) -> tuple[ClippedState, Metrics]:
        """Evaluate the rollout, then learn from it."""
        data, metrics = self.targets(state.params, batch.normalized())
        data, metrics = in_32_bits((data, metrics))  # Distrax's entropy is not
        state = self.rescaled(state, data["value_target"])
        rate = state.rate_share * self.learning_rate
        state, learned = self.replace(learning_rate=rate).learn(state, data, key)
        kl = jnp.stack([learned[name] for name in self.followed]).max()
        share = adapted_share(state.rate_share, kl, self.target_kl)
        return state.replace(rate_share=share), metrics | learned | {"learning_rate": rate}

    def learn(self, state: ClippedState, data: Any, key: jax.Array) -> tuple[ClippedState, Metrics]:
        """Run the epochs of an update."""
        return self.optimize(self.loss, state, data, key)

    def advantage_and_return(
        self, batch: Batch, value: jax.Array, value_next: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        """Return standardised GAE(lambda) advantages and discounted returns, both [T, B]."""
        advantage = self.advantages(batch, batch.reward, value, value_next)
        return standardize(advantage), self.returns(batch, value_next)

    def targets(self, params: Any, batch: Batch) -> tuple[dict[str, Any], Metrics]:
        """Evaluate a rollout into what the loss reads, [T, B, ...], and metrics.

        Options have their advantages over V[s, o_{t-1}], actions over Q[s, o_t].
        """
        data, metrics = super().targets(params, batch)
        values = self.values(params, batch)
        data["advantage_option"], data["value_target"] = self.advantage_and_return(
            batch, values.value, values.value_next
        )
        data["advantage_action"], data["q_target"] = self.advantage_and_return(
            batch, values.q, values.q_next
        )
        return data, metrics
