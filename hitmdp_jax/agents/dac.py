"""DAC: the Double Actor-Critic (Zhang & Whiteson, NeurIPS 2019), with PPO for both its actors."""

from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import static, traced
from hitmdp_jax.agents.gradient_agent import ClippedState
from hitmdp_jax.agents.option_agent import ClippedOptionAgent
from hitmdp_jax.learning.options import at_option, entropy, expected_value
from hitmdp_jax.metrics import Metrics


class DAC(ClippedOptionAgent):
    """Learns options as the policies of two augmented MDPs, from the same samples.

    The high MDP has states (s_t, o_{t-1}) and actions o_t; its policy is the call-and-return
    P(o_t | s_t, o_{t-1}), made of the master and the terminations. The low MDP has states
    (s_t, o_t) and actions a_t; its policy is pi_{o_t}(a_t | s_t). One critic serves both, for the
    high value is V[s, o_{t-1}] = sum_o P(o | s, o_{t-1}) Q[s, o]. PPO optimises the high policy,
    all epochs of it, and then the low one.

    Against MOPG: options last because their terminations say so, not because an option is its own
    nearest neighbour; K separate networks take the place of embeddings; the two surrogates are
    optimised in turn, not in one loss.

    The optimiser is shared, so parameters that a pass leaves alone still drift by their momentum,
    some ten steps' worth.
    """

    entropy_weight: float = traced(0.01)  # of P(o | s, o_{t-1}), in the high loss
    num_epochs: int = static(5)  # of each MDP

    def learn(self, state: ClippedState, data: Any, key: jax.Array) -> tuple[ClippedState, Metrics]:
        """Run PPO on the high MDP and then on the low one."""
        key_high, key_low = jax.random.split(key)
        state, high = self.optimize(self.high_loss, state, data, key_high)
        state, low = self.optimize(self.low_loss, state, data, key_low)
        return state, high | low | {"loss": high["loss"] + low["loss"]}

    def high_loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return a minibatch's loss in the high MDP: surrogate, entropy, squared error of V."""
        heads = self.heads(params, data["obs"])
        log_option = self.option_log_probs(heads, data["memory"])
        surrogate, metrics = self.surrogate(
            "option",
            at_option(log_option, data["option"]),
            at_option(data["log_option"], data["option"]),
            data["advantage_option"],
        )
        # The rollout's P(o | s, o_{t-1}): fitting V must not move the policy.
        value = expected_value(data["log_option"], heads.value)
        value_loss = 0.5 * jnp.square(value - data["value_target"]).mean()
        bonus = self.entropy_weight * entropy(log_option).mean()
        loss = self.in_units(params, value_loss) - surrogate - bonus
        return loss, metrics | {"value_loss": value_loss}

    def low_loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return a minibatch's loss in the low MDP: surrogate, squared error of Q."""
        heads = self.heads(params, data["obs"])
        log_prob = heads.policy(data["option"]).log_prob(data["action"])
        surrogate, metrics = self.surrogate(
            "action", log_prob, data["log_prob_action"], data["advantage_action"]
        )
        q = at_option(heads.value, data["option"])
        q_loss = 0.5 * jnp.square(q - data["q_target"]).mean()
        return self.in_units(params, q_loss) - surrogate, metrics | {"q_loss": q_loss}
