"""MOC: the Multi-updates Option-Critic (Klissarov & Precup 2021, "Flexible Option Learning")."""

from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import traced
from hitmdp_jax.agents.ppoc import PPOC
from hitmdp_jax.learning.options import OptionMemory, at_option
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks import OptionHeads
from hitmdp_jax.networks.action_heads import log_prob_of_each


class MOC(PPOC):
    """PPOC in which every option learns from every step, and not only the one that was executed.

    Option o learns from a step with weight P(o_t = o | s_t, o_{t-1}), the probability that it would
    have been the one (their Eq. 5), and by importance sampling. Its ratio has two factors: how much
    likelier the action would have been under it, pi_o(a | s) / pi_{o_t}(a | s), and how much
    likelier the next option would have been after it, P(o_{t+1} | s_{t+1}, o) /
    P(o_{t+1} | s_{t+1}, o_t). What a rollout brings after that is the same for both. Its value
    learns with the same weight and ratio. The master and the terminations learn as PPOC's.

    `eta` is how far this goes: with 0 only the executed option learns, which is PPOC. Theirs is the
    probability that an update is for all options, ours the mixture that this has for its mean, so
    that updates have less noise.
    """

    eta: float = traced(0.9, high=1.0)

    def targets(self, params: Any, batch: Batch) -> tuple[dict[str, Any], Metrics]:
        """Evaluate a rollout as PPOC does, and the actions under every option's policy."""
        data, metrics = super().targets(params, batch)
        policies = self.heads(params, batch.obs).every_policy()
        log_prob = log_prob_of_each(policies, batch.action)
        others = {"log_prob_each": log_prob, "log_ratio_next": self.next_option(params, batch)}
        return data | others, metrics

    def next_option(self, params: Any, batch: Batch) -> jax.Array:
        """Return log P(o_{t+1} | s_{t+1}, o) / P(o_{t+1} | s_{t+1}, o_t) [T, B, K] of a rollout.

        It is 0 where the episode or the rollout ends: no next option was drawn there.
        """
        heads, option = self.heads(params, batch.next_obs), batch.record
        drawn = jnp.roll(option, -1, axis=0)

        def after(previous: int) -> jax.Array:
            under_way = OptionMemory(jnp.full_like(option, previous), jnp.zeros_like(batch.started))
            return at_option(self.option_log_probs(heads, under_way), drawn)

        each = jnp.stack([after(o) for o in range(self.num_options)], axis=-1)
        ended = (batch.terminated | batch.truncated).at[-1].set(True)
        return jnp.where(ended[..., None], 0.0, each - at_option(each, option)[..., None])

    def of_actions(
        self, heads: OptionHeads, data: dict[str, Any]
    ) -> tuple[jax.Array, jax.Array, Metrics]:
        """Return the action policies' surrogate, the critic's loss, and metrics of a minibatch."""
        executed = jax.nn.one_hot(data["option"], self.num_options, dtype=jnp.float32)
        weight = self.eta * jnp.exp(data["log_option"]) + (1.0 - self.eta) * executed  # [N, K]
        chosen_by = data["log_prob_action"][:, None] - data["log_ratio_next"]
        log_prob = log_prob_of_each(heads.every_policy(), data["action"])
        ratio = jnp.exp(log_prob - chosen_by)
        clipped = jnp.clip(ratio, 1.0 - self.clip_eps, 1.0 + self.clip_eps)
        advantage = data["advantage_action"][:, None]
        surrogate = weight * jnp.minimum(ratio * advantage, clipped * advantage)
        of_value = weight * jnp.exp(data["log_prob_each"] - chosen_by)
        error = of_value * jnp.square(heads.value - data["q_target"][:, None])
        # How far the policy that acted has moved, as for any other algorithm.
        acted = at_option(log_prob, data["option"])
        _, metrics = self.surrogate(
            "action", acted, data["log_prob_action"], data["advantage_action"]
        )
        return surrogate.sum(-1).mean(), 0.5 * error.sum(-1).mean(), metrics
