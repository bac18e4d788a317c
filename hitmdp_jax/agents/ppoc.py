"""PPOC: Proximal Policy Option-Critic (Klissarov, Bacon, Harb & Precup 2017)."""

from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import traced
from hitmdp_jax.agents.option_agent import ClippedOptionAgent
from hitmdp_jax.learning.options import at_option, entropy, expected_value, termination_objective
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks import OptionHeads


class PPOC(ClippedOptionAgent):
    """Learns options by the option-critic's gradients, with PPO for the action policies.

    One loss of four parts: the clipped surrogate of pi_o(a | s); the termination gradient, which
    lowers beta_{o_{t-1}}(s_t) where going on is worth more than choosing anew, by
    Q[s, o_{t-1}] - sum_o pi(o | s) Q[s, o] of the critic; the critic's squared error; and the
    policy gradient of the master pi(o | s).

    The master is answerable only where it was consulted. Of that a rollout knows the probability,
    beta pi(o_t | s_t) / P(o_t | s_t, o_{t-1}), which is the very factor that the gradient of
    log P(o_t | s_t, o_{t-1}) in the master's parameters contains; so the master climbs the clipped
    surrogate of P with the terminations held constant. Its advantage is that of o_t over
    V[s, o_{t-1}], GAE over option values; the actions' advantage is zero in the mean whichever
    option is chosen and can teach the master nothing.

    Against DAC: the terminations follow the critic, not sampled advantages. Against MOPG: there
    are terminations at all.
    """

    entropy_weight: float = traced(0.01)  # of pi(o | s)
    termination_regularizer: float = traced(0.01)  # advantage granted to going on

    def loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return a minibatch's loss: both surrogates, termination, entropy, squared error."""
        heads, memory = self.heads(params, data["obs"]), data["memory"]
        surrogate_action, value_loss, of_actions = self.of_actions(heads, data)
        held = heads.replace(termination=jax.lax.stop_gradient(heads.termination))
        surrogate_option, of_options = self.surrogate(
            "option",
            at_option(self.option_log_probs(held, memory), data["option"]),
            at_option(data["log_option"], data["option"]),
            data["advantage_option"],
        )
        value = expected_value(heads.log_master, heads.value)
        termination = termination_objective(
            heads.termination, heads.value, value, memory, self.termination_regularizer
        ).mean()
        bonus = self.entropy_weight * entropy(heads.log_master).mean()
        error = self.in_units(params, value_loss)
        loss = error + termination - surrogate_action - surrogate_option - bonus
        losses = {"value_loss": value_loss, "termination_loss": termination}
        return loss, of_options | of_actions | losses

    def of_actions(
        self, heads: OptionHeads, data: dict[str, Any]
    ) -> tuple[jax.Array, jax.Array, Metrics]:
        """Return the action policies' surrogate, the critic's loss, and metrics of a minibatch."""
        log_prob = heads.policy(data["option"]).log_prob(data["action"])
        surrogate, metrics = self.surrogate(
            "action", log_prob, data["log_prob_action"], data["advantage_action"]
        )
        error = at_option(heads.value, data["option"]) - data["q_target"]
        return surrogate, 0.5 * jnp.square(error).mean(), metrics
