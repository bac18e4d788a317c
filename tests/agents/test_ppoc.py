"""PPOC's joint loss against the option-critic's gradients."""

import jax
import jax.numpy as jnp
import numpy as np

from hitmdp_jax.agents import PPOC
from tests.agents.option_batches import (
    SMALL,
    assert_ascends,
    log_density,
    option_probabilities,
)

AGENT = PPOC(**SMALL)


def test_gradient_at_the_old_policy_is_the_option_critics(agent, params, data):
    """The master weighed by the probability that it was consulted; beta by the critic."""
    sg = jax.lax.stop_gradient

    def plain(params, sample):
        heads, memory = agent.heads(params, sample["obs"]), sample["memory"]
        option, previous = sample["option"], memory.previous
        master, beta = jnp.exp(heads.log_master), jax.nn.sigmoid(heads.termination[previous])
        taken = option_probabilities(heads, previous, memory.initial)[option]
        consulted = sg(jnp.where(memory.initial, 1.0, beta) * master[option] / taken)
        going_on = sg(heads.value[previous] - master @ heads.value)
        return (
            sample["advantage_action"] * log_density(params, heads, option, sample["action"])
            + sample["advantage_option"] * consulted * heads.log_master[option]
            - 0.01 * (master * heads.log_master).sum()
            - jnp.where(memory.initial, 0.0, beta * (going_on + 0.01))
        )

    assert_ascends(agent.loss, plain, params, data)


def test_value_loss_is_by_hand(agent, params, data):
    data["q_target"] = data["q_target"] + 2.0
    _, diagnostics = agent.loss(params, data)
    np.testing.assert_allclose(diagnostics["value_loss"], 2.0, rtol=1e-4)
    np.testing.assert_allclose(diagnostics["option_kl"], 0.0, atol=1e-6)
