"""MOPG: Maximum-entropy Options Policy Gradient (HiT-MDP, ICLR 2023, sec. 4 and App. F-G)."""

from typing import Any, Self

import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import static, traced
from hitmdp_jax.agents.gradient_agent import ClippedState
from hitmdp_jax.agents.own_rewards import OwnRewards
from hitmdp_jax.learning.advantages import in_deviations, standardize
from hitmdp_jax.learning.mutual_information import action_information
from hitmdp_jax.learning.optimization import adapted_share
from hitmdp_jax.learning.options import (
    at_option,
    entropy,
    expected_value,
    kl_to_prior,
    log_sticky,
    option_statistics,
    value_of_next_option,
)
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.learning.schedules import SCHEDULES, anneal
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks.action_heads import log_prob_of_each
from hitmdp_jax.precision import in_32_bits

INFORMATION = ("none", "action")  # choices of the intrinsic reward I_t


class MOPG(OwnRewards):
    """Learns K options and the master policy that chooses among them at every step.

    Maximises the ELBO (Thm 4.1), the return of r + a_I I_t + a_H H(pi_O) + a_H H(pi_A), by PPO's
    clipped surrogate for both policies. One critic serves both: Q_O[s, o] is what follows the
    choice of o, so it holds the later steps' I and H(pi_O) but not those of the choice itself.
    The options' advantage is GAE over the soft V[s, o_{t-1}] = sum_o pi_O Q_O[s, o] + a_H H(pi_O)
    (Eq. 6), the actions' over Q_O[s, o_t]. Alg. 1 as printed gives each stream a part of the reward
    only, puts it inside gamma(...) and lacks the entropies' gradients: docs/errata.md, 15, 16, 18.

    Two additions, off by default, make options that explore (docs/options_that_pay.md). A *sticky
    prior* p(o_t | o_{t-1}) in place of the uniform one: the loss gains `prior_weight` times
    KL(P(. | s, o_{t-1}) || p). And *rewards of their own* (`OwnRewards`): options learn from other
    rewards than the task's, while the master policy and Q_O learn from the task's alone.
    """

    # In the loss, in units of the advantages' spread, whatever a task's rewards: the weights of the
    # probability to leave an option, and of the entropy of the options' usage, in nats. Alone, the
    # first leaves one option; together, none has e^(cost / weight) times the steps of another.
    switching_cost: float = traced(0.1)
    usage_weight: float = traced(0.1)
    # In the same units, at the start of a run and, where it is annealed, at its end.
    prior_weight: float = traced(0.0)
    final_prior_weight: float = traced(0.0)
    stay: float = traced(0.95, low=1e-6, high=0.999999)  # p(o_t = o_{t-1} | o_{t-1})
    entropy_weight: float = traced(0.0)  # a_H, at the start of a run where it is annealed
    final_entropy_weight: float = traced(0.0)  # a_H at the end of an annealed run
    information_weight: float = traced(0.0)  # a_I
    mutual_information: str = static("none", INFORMATION)
    entropy_schedule: str = static("constant", tuple(SCHEDULES))
    prior_schedule: str = static("constant", tuple(SCHEDULES))

    def scheduled(self, progress: jax.Array) -> Self:
        """Return the agent as it is after a fraction `progress` of the run (App. B.2)."""
        entropy_weight = anneal(
            self.entropy_schedule, self.entropy_weight, self.final_entropy_weight, progress
        )
        prior_weight = anneal(
            self.prior_schedule, self.prior_weight, self.final_prior_weight, progress
        )
        changed = super().scheduled(progress)
        return changed.replace(entropy_weight=entropy_weight, prior_weight=prior_weight)

    def update(
        self, state: ClippedState, batch: Batch, key: jax.Array
    ) -> tuple[ClippedState, Metrics]:
        """Learn from one rollout, in this order."""
        # What the rollout says of both policies and the critic, as they were when it was made.
        data, metrics = self.targets(state.params, batch.normalized())
        data, metrics = in_32_bits((data, metrics))  # Distrax's entropy is not
        # The critic's units become those of its targets; no value changes by that.
        state = self.rescaled(state, data["value_target"])
        if self.option_rewards:
            state = self.rescaled(state, data["own_target"], "own_critic")
        # Epochs of minibatches on one loss, both surrogates and the critic's.
        rate = state.rate_share * self.learning_rate
        state, learned = self.replace(learning_rate=rate).optimize(self.loss, state, data, key)
        # The next update's rate follows how far the policy went that went further.
        kl = jnp.maximum(learned["option_kl"], learned["action_kl"])
        share = adapted_share(state.rate_share, kl, self.target_kl)
        return state.replace(rate_share=share), metrics | learned | {"learning_rate": rate}

    def targets(self, params: Any, batch: Batch) -> tuple[dict[str, Any], Metrics]:
        """Evaluate a rollout into what the loss reads, [T, B, ...], and metrics."""
        obs, option, previous = batch.obs, batch.record, self.previous_option(batch.memory)
        memory_next = self.remember(batch.memory, option)
        log_option = self.option_log_probs(params, obs, previous)  # [T, B, K]
        log_option_next = self.option_log_probs(params, batch.next_obs, option)
        policy = self.policy(params, obs, option)
        every_q = self.every_q(params, obs, batch.memory)
        every_q_next = self.every_q(params, batch.next_obs, memory_next)

        option_entropy, action_entropy = entropy(log_option), policy.entropy()
        information = self.information(params, batch, log_option)
        for_information = self.information_weight * information
        for_choice = for_information + self.entropy_weight * option_entropy
        reward = batch.reward + self.entropy_weight * action_entropy  # all that the action earns

        ended = batch.terminated | batch.truncated
        entropy_next = self.entropy_weight * entropy(log_option_next)
        value = expected_value(log_option, every_q) + self.entropy_weight * option_entropy
        value_next = expected_value(log_option_next, every_q_next) + entropy_next
        q = at_option(every_q, option)
        q_next = value_of_next_option(every_q_next, log_option_next, option, ended) + entropy_next
        q_next += jnp.where(ended.at[-1].set(True), 0.0, jnp.roll(for_information, -1, axis=0))

        advantage_option = self.advantages(batch, reward + for_choice, value, value_next)
        advantage_action = self.advantages(batch, reward, q, q_next)
        # An action is also what tells which option is under way.
        credit_action = advantage_action + for_information
        data = {
            "obs": obs,
            "previous": previous,
            "option": option,
            "memory": memory_next,
            "action": batch.action,
            "log_prob_option": at_option(log_option, option),
            "log_prob_action": policy.log_prob(batch.action),
            "advantage_option": standardize(advantage_option),
            "advantage_action": standardize(credit_action),
            "entropy_weight_option": in_deviations(self.entropy_weight, advantage_option),
            "entropy_weight_action": in_deviations(self.entropy_weight, credit_action),
            "value_target": advantage_action + q,
        }
        data |= self.own_targets(params, batch) if self.option_rewards else {}
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
        policy = self.policy(params, obs, option)
        log_prob_action = policy.log_prob(data["action"])
        log_prob_option = at_option(log_option, option)
        surrogate_option, of_options = self.surrogate(
            "option", log_prob_option, data["log_prob_option"], data["advantage_option"]
        )
        surrogate_action, of_actions = self.surrogate(
            "action", log_prob_action, data["log_prob_action"], data["advantage_action"]
        )
        q = self.q(params, obs, data["memory"])
        value_loss, of_values = self.value_loss(params, q, data)
        bonus = data["entropy_weight_option"] * entropy(log_option)
        bonus += data["entropy_weight_action"] * policy.entropy()
        leaving = 1.0 - jnp.exp(at_option(log_option, data["previous"])).mean()
        log_usage = jax.nn.logsumexp(log_option, axis=0) - jnp.log(len(log_option))
        loss = value_loss - surrogate_option - surrogate_action - bonus.mean()
        loss += self.switching_cost * leaving - self.usage_weight * entropy(log_usage)
        prior = log_sticky(data["previous"], self.num_options, self.stay)
        of_prior = kl_to_prior(log_option, prior).mean()
        loss += self.prior_weight * of_prior
        metrics = of_options | of_actions | of_values | {"prior_kl": of_prior}
        if self.option_rewards:
            own_loss, of_rewards = self.own_loss(params, data)
            loss, metrics = loss + own_loss, metrics | of_rewards
        return loss, metrics

    def information(self, params: Any, batch: Batch, log_option: jax.Array) -> jax.Array:
        """Return the intrinsic reward I_t [T, B], given log P(o | s, o_{t-1}) [T, B, K]."""
        if self.mutual_information == "none":
            return jnp.zeros_like(batch.reward)
        log_action = log_prob_of_each(self.every_policy(params, batch.obs), batch.action)
        return action_information(log_option, log_action, batch.record)
