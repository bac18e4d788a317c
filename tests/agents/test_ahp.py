"""AHP's augmented policy and values against their definitions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

from hitmdp_jax.agents import AHP
from hitmdp_jax.learning.options import OptionMemory
from tests.agents.option_batches import (
    SMALL,
    B,
    K,
    O,
    T,
    assert_ascends,
    flatten,
    log_density,
    normal,
    option_probabilities,
    random_batch,
)

AGENT = AHP(**SMALL)


@pytest.fixture
def data(agent, params):
    """A rollout as the loss reads it: every switch is a stop, as is one step that chose anew."""
    batch = random_batch()
    option, memory = batch.record, batch.memory
    stop = memory.initial | (option != memory.previous)
    stop[0, 0] = True
    data = {
        "obs": batch.obs,
        "memory": memory,
        "option": option,
        "stop": stop,
        "action": batch.action,
    }
    heads = agent.heads(params, batch.obs)
    data["log_prob"] = agent.log_prob(heads, data)
    data["advantage"] = normal(np.random.default_rng(1), T, B)
    data["value_target"] = agent.value(heads, memory)
    return flatten(data)


@pytest.mark.parametrize("initial", [False, True])
def test_stops_options_and_actions_are_one_distribution(agent, params, initial):
    """Summed over b, P(b, o, a) is the call-and-return policy's; it vanishes where b = 0 switches,
    which is never drawn."""
    obs, action = normal(np.random.default_rng(1), O), np.array([0.3, -0.2])
    heads = agent.heads(params, obs)
    for previous in range(K):
        memory = OptionMemory(np.array(previous), np.array(initial))
        expected = option_probabilities(heads, previous, initial)
        for option in range(K):
            possible = [True, False] if option == previous and not initial else [True]
            joint = sum(
                np.exp(
                    agent.log_prob(
                        heads,
                        {
                            "memory": memory,
                            "option": np.array(option),
                            "stop": np.array(stop),
                            "action": action,
                        },
                    )
                )
                for stop in possible
            )
            density = np.exp(log_density(params, heads, option, action))
            np.testing.assert_allclose(joint, expected[option] * density, rtol=1e-4)


def test_what_is_drawn_has_the_probability_it_claims(agent, params, key):
    """Frequencies of (b, o) in one state."""
    n = 20_000
    obs = np.broadcast_to(normal(np.random.default_rng(1), O), (n, O))
    memory = OptionMemory(np.full(n, 2), np.zeros(n, bool))
    _, _, (option, stop) = agent.act(params, obs, memory, key)
    heads = agent.heads(params, obs[0])
    beta = expit(heads.termination[2])
    np.testing.assert_allclose(stop.mean(), beta, atol=0.02)
    counts = np.bincount(option[stop], minlength=K) / n
    np.testing.assert_allclose(counts, beta * np.exp(heads.log_master), atol=0.02)
    assert (option[~stop] == 2).all()


def test_gradient_at_the_old_policy_is_the_policy_gradient(agent, params, data):
    def plain(params, sample):
        heads = agent.heads(params, sample["obs"])
        memory, option = sample["memory"], sample["option"]
        beta = jax.nn.sigmoid(heads.termination[memory.previous])
        log_stop = jnp.log(jnp.where(sample["stop"], beta, 1 - beta))
        log_joint = (
            jnp.where(memory.initial, 0.0, log_stop)
            + jnp.where(sample["stop"], heads.log_master[option], 0.0)
            + log_density(params, heads, option, sample["action"])
        )
        return sample["advantage"] * log_joint

    assert_ascends(agent.loss, plain, params, data)


def test_an_episodes_start_has_a_value_of_its_own(agent, params):
    heads = agent.heads(params, normal(np.random.default_rng(1), 2, O))
    memory = OptionMemory(np.array([1, 1]), np.array([False, True]))
    assert heads.value.shape == (2, K + 1)
    np.testing.assert_allclose(
        agent.value(heads, memory), [heads.value[0, 1], heads.value[1, K]], rtol=1e-6
    )
