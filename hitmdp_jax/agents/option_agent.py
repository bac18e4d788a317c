"""What the five option baselines share: the network, the memory and how an option is drawn."""

from typing import Any

import distrax
import jax
import jax.numpy as jnp
import optax
from flax import struct

from hitmdp_jax.agents.base import LearnerState, Metrics, static, traced
from hitmdp_jax.learning.advantages import (
    discounted_returns,
    generalized_advantages,
    standardize,
)
from hitmdp_jax.learning.optimization import Loss, adam, minibatch_epochs
from hitmdp_jax.learning.options import (
    OptionMemory,
    at_option,
    entropy,
    option_statistics,
    option_transition,
    value_of_next_option,
)
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.networks import OptionHeads, OptionNetwork
from hitmdp_jax.networks.mlp import ACTIVATIONS


class OptionValues(struct.PyTreeNode):
    """The values of a rollout in the two augmented MDPs; `next` is in the states reached."""

    value: jax.Array  # [T, B] V[s_t, o_{t-1}] = sum_o P(o | s_t, o_{t-1}) Q[s_t, o]
    value_next: jax.Array  # [T, B] V[s_{t+1}, o_t]
    q: jax.Array  # [T, B] Q[s_t, o_t]
    q_next: jax.Array  # [T, B] Q[s_{t+1}, o_{t+1}]; V[s_{t+1}, o_t] where o_{t+1} was not drawn


class OptionAgent(struct.PyTreeNode):
    """An agent that calls an option, follows it until it terminates, and calls the next.

    Memory: the previous option o_{t-1} and whether the episode starts, `OptionMemory`. The record
    is o_t.
    """

    learning_rate: float = traced(3e-4)
    adam_eps: float = traced(1e-5)
    max_grad_norm: float = traced(0.5)
    gamma: float = traced(0.99, high=1.0)
    num_options: int = static(4)
    hidden_sizes: tuple[int, ...] = static((64, 64))
    activation: str = static("tanh", tuple(ACTIVATIONS))
    bootstrap_on_truncation: bool = static(True)

    @property
    def num_values(self) -> int:
        """Return the number of the critic's outputs: Q[s, o] of each option."""
        return self.num_options

    def heads(self, params: Any, obs: jax.Array) -> OptionHeads:
        """Return the policies, the terminations, the master and the values in states [..., O]."""
        network: Any = self._network(params["rho"].shape[-1])
        return network.apply({"params": params}, obs)

    def init(self, key: jax.Array, observation_size: int, action_size: int) -> LearnerState:
        """Return new parameters and optimiser state."""
        obs = jnp.zeros((1, observation_size))
        params = self._network(action_size).init(key, obs)["params"]
        return LearnerState(params, self._optimizer().init(params))

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
        options: Any = distrax.Categorical(self.option_log_probs(heads, memory))
        option = options.mode() if deterministic else options.sample(seed=key)
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
        """Return o_t."""
        return record

    def option_probs(self, params: Any, obs: jax.Array, memory: Any) -> jax.Array:
        """Return P(o_t | s_t, o_{t-1}) [..., K]."""
        return jnp.exp(self.option_log_probs(self.heads(params, obs), memory))

    def evaluate(self, params: Any, batch: Batch) -> tuple[dict[str, Any], OptionValues, Metrics]:
        """Evaluate a rollout with the policy that collected it.

        Returns:
          What the losses read [T, B, ...], the values, and metrics.
        """
        option = batch.record
        heads, heads_next = self.heads(params, batch.obs), self.heads(params, batch.next_obs)
        under_way = OptionMemory(option, jnp.zeros_like(batch.memory.initial))
        log_option = self.option_log_probs(heads, batch.memory)  # [T, B, K]
        log_option_next = self.option_log_probs(heads_next, under_way)
        ended = batch.terminated | batch.truncated
        values = OptionValues(
            value=(jnp.exp(log_option) * heads.value).sum(-1),
            value_next=(jnp.exp(log_option_next) * heads_next.value).sum(-1),
            q=at_option(heads.value, option),
            q_next=value_of_next_option(heads_next.value, log_option_next, option, ended),
        )
        policy = heads.policy(option)
        data = {
            "obs": batch.obs,
            "memory": batch.memory,
            "option": option,
            "action": batch.action,
            "log_option": log_option,
            "log_prob_action": policy.log_prob(batch.action),
        }
        metrics = {
            "option_entropy": entropy(log_option).mean(),
            "action_entropy": policy.entropy().mean(),
            "termination": jax.nn.sigmoid(at_option(heads_next.termination, option)).mean(),
            "value": values.value.mean(),
        }
        return data, values, metrics | self.statistics(batch, option)

    def statistics(self, batch: Batch, option: jax.Array) -> Metrics:
        """Count the steps and activations of the options [T, B] of a rollout."""
        return option_statistics(option, batch.memory.previous, batch.started, self.num_options)

    def _network(self, action_size: int) -> OptionNetwork:
        return OptionNetwork(
            action_size, self.num_options, self.num_values, self.hidden_sizes, self.activation
        )

    def _optimizer(self) -> optax.GradientTransformation:
        return adam(self.learning_rate, self.max_grad_norm, self.adam_eps)


class ClippedOptionAgent(OptionAgent):
    """An option agent whose policies PPO optimises."""

    gae_lambda: float = traced(0.95, high=1.0)
    clip_eps: float = traced(0.2)
    num_epochs: int = static(10)
    minibatch_size: int = static(64)

    def advantage_and_return(
        self, batch: Batch, value: jax.Array, value_next: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        """Return standardised GAE(lambda) advantages and discounted returns, both [T, B]."""
        ends = batch.terminated, batch.truncated
        bootstrap = self.bootstrap_on_truncation
        advantage = generalized_advantages(
            batch.reward, value, value_next, *ends, self.gamma, self.gae_lambda, bootstrap
        )
        returns = discounted_returns(batch.reward, value_next, *ends, self.gamma, bootstrap)
        return standardize(advantage), returns

    def optimize(
        self, loss: Loss, state: LearnerState, data: Any, key: jax.Array
    ) -> tuple[LearnerState, Metrics]:
        """Run `num_epochs` of minibatches of the data [T, B, ...] on a loss."""
        params, opt_state, diagnostics = minibatch_epochs(
            loss,
            self._optimizer(),
            state.params,
            state.opt_state,
            jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), data),
            key,
            num_epochs=self.num_epochs,
            minibatch_size=self.minibatch_size,
        )
        return LearnerState(params, opt_state), diagnostics
