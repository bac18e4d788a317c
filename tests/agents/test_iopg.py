"""IOPG's recursion against the enumeration of every sequence of options."""

import itertools

import jax
import numpy as np
import pytest
from scipy.special import log_softmax

from hitmdp_jax.agents import IOPG
from hitmdp_jax.agents.iopg import BeliefMemory
from tests.agents.option_batches import (
    SMALL,
    B,
    K,
    O,
    T,
    log_density,
    normal,
    option_probabilities,
    random_batch,
)
from tests.programs import compiled

AGENT = IOPG(**SMALL)


@pytest.fixture
def batch():
    """Environment 0 and 1 start episodes amid the rollout, 2 has one under way throughout."""
    batch = random_batch()
    posterior = log_softmax(2.0 * normal(np.random.default_rng(1), T, B, K), axis=-1)
    memory = batch.memory
    return batch.replace(memory=BeliefMemory(memory.previous, memory.initial, posterior))


def likelihoods_of_every_path(agent, params, batch, b, first, last):
    """Return the K^n option sequences of steps first..last, and P(o_first.., a_first.. | ...)."""
    heads = [agent.heads(params, batch.obs[t, b]) for t in range(first, last + 1)]
    before = np.exp(batch.memory.log_posterior[0, b])
    initial = bool(batch.memory.initial[first, b])
    rows = [
        np.stack([option_probabilities(h, o, initial and i == 0) for o in range(K)])
        for i, h in enumerate(heads)
    ]  # [K_prev, K] of each step
    densities = [
        np.exp([float(log_density(params, h, o, batch.action[first + i, b])) for o in range(K)])
        for i, h in enumerate(heads)
    ]
    paths = list(itertools.product(range(K), repeat=len(heads)))
    weights = []
    for path in paths:
        weight = (before @ rows[0])[path[0]] * densities[0][path[0]]
        for i in range(1, len(path)):
            weight *= rows[i][path[i - 1], path[i]] * densities[i][path[i]]
        weights.append(weight)
    return np.array(paths), np.array(weights)


@pytest.mark.parametrize(
    ("b", "first", "last"),
    [(2, 0, 4), (0, 0, 2), (0, 3, 4), (1, 2, 4)],  # within one episode each
)
def test_recursion_equals_enumeration(agent, params, batch, b, first, last):
    log_belief, log_posterior, log_likelihood = agent.infer(params, batch)
    paths, weights = likelihoods_of_every_path(agent, params, batch, b, first, last)
    # P(a_first..a_last | states) is the sum over paths, the product of one-step likelihoods.
    np.testing.assert_allclose(
        log_likelihood[first : last + 1, b].sum(), np.log(weights.sum()), rtol=1e-4
    )
    final = np.array([weights[paths[:, -1] == o].sum() for o in range(K)]) / weights.sum()
    np.testing.assert_allclose(np.exp(log_posterior[last, b]), final, rtol=1e-3, atol=1e-6)
    # Before a_last is seen, its density has no say.
    heads = agent.heads(params, batch.obs[last, b])
    density = np.exp(
        [float(log_density(params, heads, o, batch.action[last, b])) for o in range(K)]
    )
    blind = final / density
    np.testing.assert_allclose(
        np.exp(log_belief[last, b]), blind / blind.sum(), rtol=1e-3, atol=1e-6
    )


def test_the_memory_carries_the_recursion_from_step_to_step(agent, params, key):
    """Acting, step by step, and the update's pass over the rollout see the same posterior."""
    obs = normal(np.random.default_rng(1), T, B, O)
    memory = agent.initial_memory(key, (B,))
    steps = []
    for t in range(T):
        if t == 2:  # environment 1 starts anew
            fresh = agent.initial_memory(key, (B,))
            anew = np.arange(B) == 1
            memory = jax.tree.map(
                lambda x, y, m=anew: np.where(m.reshape(-1, *[1] * (x.ndim - 1)), x, y),
                fresh,
                memory,
            )
        action, new_memory, option = agent.act(params, obs[t], memory, jax.random.key(t))
        steps.append((memory, action, option))
        memory = new_memory
    memories, actions, options = jax.tree.map(lambda *x: np.stack(x), *steps)
    batch = random_batch().replace(obs=obs, action=actions, memory=memories, record=options)
    _, log_posterior, _ = agent.infer(params, batch)
    np.testing.assert_allclose(log_posterior[-1], memory.log_posterior, rtol=1e-3, atol=1e-5)
    np.testing.assert_array_equal(options[-1], memory.previous)


def test_gradient_is_reinforce_on_the_likelihood_of_the_actions(agent, params, batch):
    """-mean of log P(a_t | history) (R_t - V_t); the baseline moves no policy."""
    returns = normal(np.random.default_rng(3), T, B)
    log_belief, _, _ = agent.infer(params, batch)
    value = (np.exp(log_belief) * agent.heads(params, batch.obs).value).sum(-1)

    def plain(params):
        return -(agent.infer(params, batch)[2] * (returns - value)).mean()

    @compiled
    def gradients(params):
        result = jax.grad(lambda p: agent.loss(p, (batch, returns))[0])(params)
        return result, jax.grad(plain)(params)

    result, expected = gradients(params)
    for name in ("policies", "rho", "terminations", "master"):
        assert any(np.abs(x).max() > 1e-4 for x in jax.tree.leaves(result[name])), name
        jax.tree.map(
            lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-5),
            result[name],
            expected[name],
        )


def test_executed_options_do_not_matter(agent, params, batch):
    memory = batch.memory
    other = batch.replace(
        record=(batch.record + 1) % K, memory=memory.replace(previous=(memory.previous + 2) % K)
    )
    returns = np.ones((T, B))
    np.testing.assert_array_equal(
        agent.loss(params, (batch, returns))[0], agent.loss(params, (other, returns))[0]
    )


def test_first_belief_is_the_masters(agent, params, batch):
    log_belief, _, _ = agent.infer(params, batch)
    heads = agent.heads(params, batch.obs)
    np.testing.assert_allclose(log_belief[3, 0], heads.log_master[3, 0], rtol=1e-5)


def test_a_perfect_baseline_leaves_no_loss(agent, params, batch):
    """Where the rewards are zero, so are returns and, with a critic of zeros, the value loss."""
    batch = batch.replace(reward=np.zeros((T, B)))
    critic = jax.tree.map(np.zeros_like, params["critic"])
    state = agent.init(jax.random.key(0), agent.spec).replace(params=params | {"critic": critic})
    _, metrics = agent.update(state, batch, jax.random.key(0))
    assert metrics["value_loss"] == 0
