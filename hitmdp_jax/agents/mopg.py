"""MOPG: Maximum-entropy Options Policy Gradient (HiT-MDP, ICLR 2023, sec. 4 and App. F-G)."""

from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import static, traced
from hitmdp_jax.agents.gradient_agent import ScaledAgent
from hitmdp_jax.agents.hit_policy import HitPolicy
from hitmdp_jax.learning import mutual_information as mi
from hitmdp_jax.learning.advantages import standardize
from hitmdp_jax.learning.metrics import Metrics
from hitmdp_jax.learning.options import (
    at_option,
    entropy,
    expected_value,
    option_statistics,
    value_of_next_option,
)
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.learning.schedules import SCHEDULES, anneal


class MOPG(HitPolicy, ScaledAgent):
    """Learns K options and the master policy that chooses among them at every step.

    Maximises the ELBO (Thm 4.1) by PPO's clipped surrogate for both policies. The option stream is
    rewarded r + a_I I_t + a_H H(pi_O), the action stream r + a_H H(pi_A). The advantages are GAE
    over V[s, o_{t-1}] = sum_o pi_O(o | s, o_{t-1}) Q_O[s, o] (Eq. 6) and over Q_O[s, o_t]; the
    printed Alg. 1 puts the reward-like terms inside gamma(...), see docs/errata.md.
    """

    switching_cost: float = traced(0.0)
    entropy_weight: float = traced(0.0)  # a_H, at the start of a run where it is annealed
    final_entropy_weight: float = traced(0.0)  # a_H at the end of an annealed run
    information_weight: float = traced(0.0)  # a_I
    mutual_information: str = static("none", mi.CHOICES)
    entropy_schedule: str = static("constant", tuple(SCHEDULES))

    def scheduled(self, progress: jax.Array) -> "MOPG":
        """Return the agent as it is after a fraction `progress` of the run (App. B.2)."""
        annealed = anneal(
            self.entropy_schedule, self.entropy_weight, self.final_entropy_weight, progress
        )
        return self.replace(entropy_weight=annealed)

    def targets(self, params: Any, batch: Batch) -> tuple[dict[str, Any], Metrics]:
        """Evaluate a rollout into what the loss reads, [T, B, ...], and metrics."""
        obs, option, previous = batch.obs, batch.record, self.previous_option(batch.memory)
        memory_next = self.remember(batch.memory, option)
        log_option = self.option_log_probs(params, obs, previous)  # [T, B, K]
        log_option_next = self.option_log_probs(params, batch.next_obs, option)
        policy = self.policy(params, obs, option)
        every_q = self.every_q(params, obs, batch.memory)
        every_q_next = self.every_q(params, batch.next_obs, memory_next)

        value = expected_value(log_option, every_q)
        value_next = expected_value(log_option_next, every_q_next)
        q = at_option(every_q, option)
        ended = batch.terminated | batch.truncated
        q_next = value_of_next_option(every_q_next, log_option_next, option, ended)

        option_entropy, action_entropy = entropy(log_option), policy.entropy()
        information = self.information(params, batch, log_option)
        reward_option = batch.reward + self.information_weight * information
        reward_option += self.entropy_weight * option_entropy
        reward_action = batch.reward + self.entropy_weight * action_entropy
        advantage_option = self.advantages(batch, reward_option, value, value_next)
        advantage_action = self.advantages(batch, reward_action, q, q_next)
        data = {
            "obs": obs,
            "previous": previous,
            "option": option,
            "memory": memory_next,
            "action": batch.action,
            "log_prob_option": at_option(log_option, option),
            "log_prob_action": policy.log_prob(batch.action),
            "advantage_option": standardize(advantage_option),
            "advantage_action": standardize(advantage_action),
            "value_target": advantage_action + q,
        }
        metrics = {
            "option_entropy": option_entropy.mean(),
            "action_entropy": action_entropy.mean(),
            "information": information.mean(),
            "value": value.mean(),
        }
        return data, metrics | option_statistics(option, previous, batch.started, self.num_options)

    def loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return the loss of a minibatch: both surrogates and the critic's squared error."""
        obs, option = data["obs"], data["option"]
        log_option = self.option_log_probs(params, obs, data["previous"])
        log_prob_action = self.policy(params, obs, option).log_prob(data["action"])
        log_prob_option = at_option(log_option, option)
        surrogate_option, of_options = self.surrogate(
            "option", log_prob_option, data["log_prob_option"], data["advantage_option"]
        )
        surrogate_action, of_actions = self.surrogate(
            "action", log_prob_action, data["log_prob_action"], data["advantage_action"]
        )
        q = self.q(params, obs, data["memory"])
        value_loss, of_values = self.value_loss(params, q, data)
        leaving = 1.0 - jnp.exp(at_option(log_option, data["previous"])).mean()
        loss = value_loss - surrogate_option - surrogate_action + self.switching_cost * leaving
        return loss, of_options | of_actions | of_values

    def information(self, params: Any, batch: Batch, log_option: jax.Array) -> jax.Array:
        """Return the intrinsic reward I_t [T, B], given log P(o | s, o_{t-1}) [T, B, K]."""
        if self.mutual_information == "none":
            return jnp.zeros_like(batch.reward)
        obs, option = batch.obs, batch.record
        log_action = self.every_policy(params, obs).log_prob(batch.action[..., None, :])
        if self.mutual_information == "action":
            return mi.action_information(log_option, log_action, option)
        if self.mutual_information == "usage":
            return mi.usage_information(log_option, log_action, option)
        every = jnp.arange(self.num_options)
        usage = mi.usage(self.previous_option(batch.memory), self.num_options)
        log_each = jax.vmap(
            lambda k: self.option_log_probs(params, obs, jnp.full_like(option, k)), out_axes=-2
        )(every)  # [T, B, K previous, K]
        log_marginal = jax.nn.logsumexp(log_each, axis=-2, b=usage[:, None])
        return mi.previous_information(log_option, log_action, option, log_marginal)
