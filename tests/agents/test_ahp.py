"""AHP's augmented policy and values against their definitions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.agents import AHP
from hitmdp_jax.learning.options import OptionMemory
from tests.agents.compiled import Compiled
from tests.agents.option_batches import (
    B,
    K,
    O,
    T,
    assert_ascends,
    flatten,
    log_density,
    option_probabilities,
    random_batch,
)


@pytest.fixture
def agent():
    return Compiled(AHP())


@pytest.fixture
def data(agent, params, key):
    """A rollout as the loss reads it: every switch is a stop, as is one step that chose anew."""
    batch = random_batch(key)
    option, memory = batch.record, batch.memory
    data = {
        "obs": batch.obs,
        "memory": memory,
        "option": option,
        "stop": (memory.initial | (option != memory.previous)).at[0, 0].set(True),
        "action": batch.action,
    }
    heads = agent.heads(params, batch.obs)
    data["log_prob"] = agent.log_prob(heads, data)
    data["advantage"] = jax.random.normal(key, (T, B))
    data["value_target"] = agent.value(heads, memory)
    return flatten(data)


@pytest.mark.parametrize("initial", [False, True])
def test_stops_options_and_actions_are_one_distribution(agent, params, key, initial):
    """Summed over b, P(b, o, a) is the call-and-return policy's; it vanishes where b = 0 switches,
    which is never drawn."""
    obs, action = jax.random.normal(key, (O,)), jnp.array([0.3, -0.2])
    heads = agent.heads(params, obs)
    for previous in range(K):
        memory = OptionMemory(jnp.array(previous), jnp.array(initial))
        expected = option_probabilities(heads, previous, initial)
        for option in range(K):
            possible = [True, False] if option == previous and not initial else [True]
            joint = sum(
                jnp.exp(
                    agent.log_prob(
                        heads,
                        {
                            "memory": memory,
                            "option": jnp.array(option),
                            "stop": jnp.array(stop),
                            "action": action,
                        },
                    )
                )
                for stop in possible
            )
            density = jnp.exp(log_density(params, heads, option, action))
            np.testing.assert_allclose(joint, expected[option] * density, rtol=1e-4)


def test_what_is_drawn_has_the_probability_it_claims(agent, params, key):
    """Frequencies of (b, o) in one state."""
    n = 20_000
    obs = jnp.broadcast_to(jax.random.normal(key, (O,)), (n, O))
    memory = OptionMemory(jnp.full(n, 2), jnp.zeros(n, bool))
    _, _, (option, stop) = agent.act(params, obs, memory, key)
    heads = agent.heads(params, obs[0])
    beta = jax.nn.sigmoid(heads.termination[2])
    np.testing.assert_allclose(stop.mean(), beta, atol=0.02)
    counts = np.bincount(np.asarray(option)[np.asarray(stop)], minlength=K) / n
    np.testing.assert_allclose(counts, beta * jnp.exp(heads.log_master), atol=0.02)
    assert (np.asarray(option)[~np.asarray(stop)] == 2).all()


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


def test_an_episodes_start_has_a_value_of_its_own(agent, params, key):
    heads = agent.heads(params, jax.random.normal(key, (2, O)))
    memory = OptionMemory(jnp.array([1, 1]), jnp.array([False, True]))
    assert heads.value.shape == (2, K + 1)
    np.testing.assert_allclose(
        agent.value(heads, memory), [heads.value[0, 1], heads.value[1, K]], rtol=1e-6
    )
