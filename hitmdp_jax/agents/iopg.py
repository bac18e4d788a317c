"""IOPG: the Inferred Option Policy Gradient (Smith, Hoof & Pineau, ICML 2018)."""

import math
from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import LearnerState
from hitmdp_jax.agents.option_agent import OptionAgent
from hitmdp_jax.learning.optimization import gradient_step
from hitmdp_jax.learning.options import (
    OptionMemory,
    entropy,
    expected_value,
    option_belief,
    option_statistics,
)
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks.action_heads import log_prob_of_each


class BeliefMemory(OptionMemory):
    """What an outside observer, who sees states and actions, makes of the options."""

    log_posterior: jax.Array  # [..., K] log P(o_{t-1} | s_0..s_{t-1}, a_0..a_{t-1})


class IOPG(OptionAgent):
    """Learns options as hidden variables: every option answers for an action it might have taken.

    The belief b_t(o) = P(o_t = o | s_0..s_t, a_0..a_{t-1}) follows the forward recursion of
    `option_belief`. With it the policy is one of states and past actions alone,

        P(a_t | s_0..s_t, a_0..a_{t-1}) = sum_o b_t(o) pi_o(a_t | s_t),

    and IOPG is REINFORCE with a baseline on its logarithm, so that the gradient reaches the
    policies, terminations and master at once, through the recursion. The baseline is the belief's
    value sum_o b_t(o) Q[s_t, o]. Options are executed by call-and-return, which has the same
    distribution of actions.

    The paper updates after whole episodes. Here an update sees a rollout, whatever episodes it
    cuts: the belief is carried from rollout to rollout, held constant where a rollout starts, as in
    truncated backpropagation through time; returns bootstrap from the belief's value where a
    rollout ends. So an update costs the same whether episodes last 10 steps or 1000. The price is a
    bias, in what the belief owes to steps before the rollout and in the bootstrap, which falls as
    `rollout_length` grows; 16 steps learn InvertedPendulum about twice as fast as 64.

    Against MOPG: nothing depends on which option was executed; no surrogate, GAE or epochs.
    """

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> BeliefMemory:
        """Return the memory of an episode's start: no option is under way."""
        start = super().initial_memory(key, batch_shape)
        shape = *batch_shape, self.num_options
        uniform = jnp.full(shape, -math.log(self.num_options), jnp.float32)
        return BeliefMemory(start.previous, start.initial, uniform)

    def act(
        self,
        params: Any,
        obs: jax.Array,
        memory: BeliefMemory,
        key: jax.Array,
        deterministic: bool = False,
    ) -> tuple[jax.Array, BeliefMemory, jax.Array]:
        """Choose o_t, then a_t, and see what a_t says of the options."""
        action, new, option = super().act(params, obs, memory, key, deterministic)
        heads = self.heads(params, obs)  # the same as above, and compiled as one
        log_belief = option_belief(
            memory.log_posterior, heads.log_master, heads.termination, memory.initial
        )
        log_density = log_prob_of_each(heads.every_policy(), action)
        posterior = jax.nn.log_softmax(log_belief + log_density)
        return action, BeliefMemory(new.previous, new.initial, posterior), option

    def update(
        self, state: LearnerState, batch: Batch, key: jax.Array
    ) -> tuple[LearnerState, Metrics]:
        """Take one step of REINFORCE with a baseline."""
        batch = batch.normalized()
        heads, heads_next = (self.heads(state.params, x) for x in (batch.obs, batch.next_obs))
        log_belief, log_posterior, _ = self.infer(state.params, batch)
        log_belief_next = option_belief(
            log_posterior,
            heads_next.log_master,
            heads_next.termination,
            jnp.zeros_like(batch.started),
        )
        value_target = self.returns(batch, expected_value(log_belief_next, heads_next.value))
        params, opt_state, diagnostics = gradient_step(
            self.loss, self.optimizer(), state.params, state.opt_state, (batch, value_target)
        )
        stop = jax.nn.sigmoid(heads_next.termination)
        metrics = {
            "belief_entropy": entropy(log_belief).mean(),
            "action_entropy": heads.policy(batch.record).entropy().mean(),
            "termination": (jnp.exp(log_posterior) * stop).sum(-1).mean(),
        }
        options = option_statistics(
            batch.record, batch.memory.previous, batch.started, self.num_options
        )
        return LearnerState(params, opt_state), metrics | diagnostics | options

    def infer(self, params: Any, batch: Batch) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Run the recursion over a rollout.

        Returns:
          log b_t [T, B, K], before a_t was seen; the posterior log P(o_t | s_0..s_t, a_0..a_t)
          [T, B, K]; and log P(a_t | s_0..s_t, a_0..a_{t-1}) [T, B].
        """
        heads = self.heads(params, batch.obs)
        log_density = log_prob_of_each(heads.every_policy(), batch.action)  # [T, B, K]

        def step(log_posterior: jax.Array, inputs: tuple[jax.Array, ...]):
            *states, log_density_t = inputs
            log_belief = option_belief(log_posterior, *states)
            log_joint = log_belief + log_density_t
            log_likelihood = jax.nn.logsumexp(log_joint, axis=-1)
            log_posterior = log_joint - log_likelihood[..., None]
            return log_posterior, (log_belief, log_posterior, log_likelihood)

        inputs = heads.log_master, heads.termination, batch.memory.initial, log_density
        return jax.lax.scan(step, batch.memory.log_posterior[0], inputs)[1]

    def loss(self, params: Any, data: tuple[Batch, jax.Array]) -> tuple[jax.Array, Metrics]:
        """Return a rollout's loss: log-likelihood by advantage, and the baseline's error."""
        batch, value_target = data
        log_belief, _, log_likelihood = self.infer(params, batch)
        belief = jax.lax.stop_gradient(jnp.exp(log_belief))  # the baseline moves no policy
        value = (belief * self.heads(params, batch.obs).value).sum(-1)
        advantage = jax.lax.stop_gradient(value_target - value)
        value_loss = 0.5 * jnp.square(value - value_target).mean()
        metrics = {"value_loss": value_loss, "value": value.mean()}
        return value_loss - (log_likelihood * advantage).mean(), metrics
