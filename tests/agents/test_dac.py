"""DAC's two augmented MDPs against their definitions."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import expit

from hitmdp_jax.agents import DAC
from tests.agents.option_batches import (
    SMALL,
    K,
    assert_ascends,
    log_density,
    normal,
    option_probabilities,
)
from tests.programs import compiled

AGENT = DAC(**SMALL)


def pi_hat(agent, params, sample):
    """P(o | s_t, o_{t-1}) [K]: the high MDP's policy in one state."""
    heads, memory = agent.heads(params, sample["obs"]), sample["memory"]
    return option_probabilities(heads, memory.previous, memory.initial)


def log_pi_bar(agent, params, sample):
    """log pi(a_t | s_t, o_t): the low MDP's policy."""
    heads = agent.heads(params, sample["obs"])
    return log_density(params, heads, sample["option"], sample["action"])


def test_both_augmented_policies_equal_their_definitions(agent, params, data):
    both = jax.vmap(lambda x: (pi_hat(agent, params, x), log_pi_bar(agent, params, x)))
    high, low = compiled(both)(data)
    np.testing.assert_allclose(high.sum(-1), 1.0, rtol=1e-5)
    np.testing.assert_allclose(np.exp(data["log_option"]), high, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(data["log_prob_action"], low, rtol=1e-4, atol=1e-4)


def test_gradients_at_the_old_policies_are_policy_gradients(agent, params, data):
    """Mean of A grad log pi in each MDP, and the entropy bonus of the high one; no more."""

    def plain_high(params, sample):
        pi = pi_hat(agent, params, sample)
        bonus = -agent.entropy_weight * (pi * jnp.log(pi)).sum()
        return sample["advantage_option"] * jnp.log(pi[sample["option"]]) + bonus

    def plain_low(params, sample):
        return sample["advantage_action"] * log_pi_bar(agent, params, sample)

    assert_ascends(agent.high_loss, plain_high, params, data)
    assert_ascends(agent.low_loss, plain_low, params, data)


def test_each_pass_leaves_the_other_mdps_policy_alone(agent, params, data):
    @compiled
    def gradients(params):
        losses = agent.high_loss, agent.low_loss
        return [jax.grad(lambda p, loss=loss: loss(p, data)[0])(params) for loss in losses]

    high, low = gradients(params)
    for gradient, idle in ((high, ("policies", "rho")), (low, ("terminations", "master"))):
        for name in idle:
            assert all((x == 0).all() for x in jax.tree.leaves(gradient[name])), name


def test_value_losses_are_by_hand(agent, params, data):
    data |= {"value_target": data["value_target"] + 2.0, "q_target": data["q_target"] - 4.0}
    np.testing.assert_allclose(agent.high_loss(params, data)[1]["value_loss"], 2.0, rtol=1e-4)
    np.testing.assert_allclose(agent.low_loss(params, data)[1]["q_loss"], 8.0, rtol=1e-4)


def test_first_policies_are_as_specified(agent, key):
    obs = normal(np.random.default_rng(1), 50, 4)
    heads = agent.heads(agent.init(key, agent.spec).params, obs)
    np.testing.assert_allclose(expit(heads.termination), 0.5, atol=0.01)
    np.testing.assert_allclose(np.exp(heads.log_master), 1 / K, atol=0.01)
    np.testing.assert_allclose(heads.std, np.log(2.0), rtol=1e-6)
