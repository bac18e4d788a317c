"""OC's master, returns and loss against their definitions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

from hitmdp_jax.agents import OC
from hitmdp_jax.learning.options import OptionMemory
from tests.agents.compiled import Compiled
from tests.agents.option_batches import (
    SMALL,
    B,
    K,
    O,
    T,
    log_density,
    normal,
    random_batch,
)

AGENT = OC(**SMALL)


@pytest.fixture
def data(agent, params):
    data, _ = agent.targets(params, random_batch())
    return data | {"q_target": normal(np.random.default_rng(1), T, B)}


def test_the_master_is_epsilon_greedy(agent, params):
    heads = agent.heads(params, normal(np.random.default_rng(1), O))
    expected = np.full(K, 0.1 / K)
    expected[int(heads.value.argmax())] += 0.9
    np.testing.assert_allclose(np.exp(heads.log_master), expected, rtol=1e-5)


def test_a_greedy_master_has_finite_metrics(params):
    metrics = Compiled(OC(epsilon=0.0, **SMALL)).targets(params, random_batch())[1]
    assert all(np.isfinite(x).all() for x in metrics.values())


def test_an_option_that_never_terminates_goes_on(agent, params, key):
    output = jax.tree.map(np.zeros_like, params["terminations"]["output"])
    output["bias"] -= 50.0
    params = params | {"terminations": params["terminations"] | {"output": output}}
    memory = OptionMemory(np.arange(400) % K, np.zeros(400, bool))
    _, _, option = agent.act(params, np.ones((400, O)), memory, key)
    np.testing.assert_array_equal(option, memory.previous)


def test_value_upon_arrival_is_by_hand(agent, params):
    obs = normal(np.random.default_rng(1), O)
    heads = agent.heads(params, obs)
    for option in range(K):
        beta = expit(heads.termination[option])
        expected = (1 - beta) * heads.value[option] + beta * heads.value.max()
        result = agent.value_upon_arrival(params, obs, option)
        np.testing.assert_allclose(result, expected, rtol=1e-5)


def test_gradient_is_the_option_critics(agent, params, data):
    sg = jax.lax.stop_gradient

    def plain(params, sample):
        heads, memory, option = (
            agent.heads(params, sample["obs"]),
            sample["memory"],
            sample["option"],
        )
        q, previous = heads.value, memory.previous
        std = jnp.log1p(jnp.exp(params["rho"][option]))
        entropy = (0.5 * jnp.log(2 * jnp.pi * jnp.e) + jnp.log(std)).sum()
        log_pi = log_density(params, heads, option, sample["action"])
        going_on = q[previous] - (0.9 * q.max() + 0.1 * q.mean()) + 0.01
        beta = jnp.where(memory.initial, 0.0, jax.nn.sigmoid(heads.termination[previous]))
        return (
            0.5 * (q[option] - sample["q_target"]) ** 2
            - log_pi * sg(sample["q_target"] - q[option])
            - 0.01 * entropy
            + beta * sg(going_on)
        )

    @jax.jit
    def gradients(params):
        each = jax.vmap(jax.vmap(plain, in_axes=(None, 0)), in_axes=(None, 0))
        result = jax.grad(lambda p: agent.loss(p, data)[0])(params)
        return result, jax.grad(lambda p: each(p, data).mean())(params)

    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-4), *gradients(params)
    )


def test_the_target_network_is_copied_when_due(key):
    agent = Compiled(OC(target_period=3 * T, **SMALL))
    state, batch = agent.init(key, agent.spec), random_batch()
    first = state.params
    for expected_age in (T, 2 * T, 0):
        state, _ = agent.update(state, batch, key)
        assert state.target.age == expected_age
        copied = state.params if expected_age == 0 else first
        jax.tree.map(np.testing.assert_array_equal, state.target.params, copied)


def test_returns_bootstrap_from_the_target_network(agent, params, key):
    """With gamma 0 the target network cannot matter, else it does."""
    batch = random_batch()
    state = agent.init(key, agent.spec)
    other = state.replace(target=state.target.replace(params=params))
    for gamma, same in ((0.0, True), (0.99, False)):
        update = agent.replace(gamma=gamma).update
        losses = [update(s, batch, key)[1]["value_loss"] for s in (state, other)]
        assert np.isclose(*losses, rtol=1e-6) == same
