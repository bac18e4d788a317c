"""Options with rewards of their own, under a master policy that learns from the task's."""

from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import static, traced
from hitmdp_jax.agents.gradient_agent import ClippedAgent
from hitmdp_jax.agents.hit_policy import HitPolicy
from hitmdp_jax.envs.option_rewards import LEARNED
from hitmdp_jax.learning.advantages import generalized_advantages
from hitmdp_jax.learning.options import (
    at_option,
    change_under_option,
    even_weights,
    standardize_by_option,
)
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics


class OwnRewards(HitPolicy, ClippedAgent):
    """An agent of HiT-MDPs whose options may learn from rewards of their own.

    With n `option_rewards`, names of what the task offers (`envs.option_rewards`), option k learns
    its actions from the (k mod n)-th, as if it went on for ever (after SOL, arXiv 2509.00338). A
    critic of its own predicts that reward's return under the discount `own_gamma`. The name
    "learned" stands for log q(o | where the option led) - log p(o), where q learns to tell the
    options apart by a direction of each (`networks.directions`). With no names, actions learn from
    the task's reward.
    """

    own_gamma: float = traced(0.95, high=1.0)
    option_rewards: tuple[str, ...] = static((), of=str)
    learned_steps: int = static(8)  # after which it is asked where an option led, for "learned"
    posterior_scale: float = traced(2.0)
    posterior_reads: tuple[str, ...] = static((), of=str)

    def own_targets(self, params: Any, batch: Batch) -> dict[str, Any]:
        """Return what `own_loss` reads, [T, B, ...], and the actions' advantage."""
        advantage, target = self.own_advantages(params, batch)
        advantage = standardize_by_option(advantage, batch.record, self.num_options)
        targets = {"advantage_action": advantage, "own_target": target}
        if LEARNED in self.option_rewards:
            # p(o) is uniform: without the weights, q would follow the options that are used most.
            weight = even_weights(batch.record, self.num_options)
            targets |= {"change": self.change(batch), "option_weight": weight}
        return targets

    def own_loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return the error of the own critic of a minibatch, and that of q where it learns."""
        q = self.own_q(params, data["obs"], data["option"])
        loss, _ = self.value_loss(params, q, data, "own_target", "own_critic")
        if LEARNED not in self.option_rewards:
            return loss, {}
        told = at_option(self.log_posterior(params, data["change"]), data["option"])
        loss -= (data["option_weight"] * told).mean()
        return loss, {"learned_information": told.mean() + jnp.log(self.num_options)}

    def own_advantages(self, params: Any, batch: Batch) -> tuple[jax.Array, jax.Array]:
        """Return GAE [T, B] of the actions by their options' own rewards, and the critic's targets.

        Where the master policy goes to another option, the option's own value takes over, as at a
        time limit: to be left is neither its fault nor its merit.
        """
        option = batch.record
        q, q_next = (
            self.own_q(params, batch.obs, option),
            self.own_q(params, batch.next_obs, option),
        )
        left = option != jnp.roll(option, -1, axis=0)
        ended = batch.truncated | left
        advantage = generalized_advantages(
            self.own_reward(params, batch),
            q,
            q_next,
            batch.terminated,
            ended,
            self.own_gamma,
            self.gae_lambda,
        )
        return advantage, advantage + q

    def own_reward(self, params: Any, batch: Batch) -> jax.Array:
        """Return what the option in charge is paid [T, B], by the reward that is its own.

        The learned one is log q(o | where it led) - log p(o) in nats, p uniform.
        """
        assert batch.option_reward is not None
        paid = jnp.asarray(batch.option_reward)
        if LEARNED in self.option_rewards:
            log_posterior = self.log_posterior(params, self.change(batch))
            told = at_option(log_posterior, batch.record) + jnp.log(self.num_options)
            paid = paid.at[..., self.option_rewards.index(LEARNED)].set(told)
        of_each = jnp.arange(self.num_options) % len(self.option_rewards)
        return at_option(paid[..., of_each], batch.record)

    def log_posterior(self, params: Any, change: jax.Array) -> jax.Array:
        """Return log q(o | change) [..., K] for changes of the observation [..., O].

        A logit grows by `posterior_scale` nats where a change goes one unit along the direction.
        """
        along = self._apply(params, "along_directions", change)
        return jax.nn.log_softmax(self.posterior_scale * along)

    def change(self, batch: Batch) -> jax.Array:
        """Return where the option in charge leads in `learned_steps`, [T, B, O], normalised."""
        ended = batch.terminated | batch.truncated
        return change_under_option(
            batch.obs, batch.next_obs, batch.record, ended, self.learned_steps
        )
