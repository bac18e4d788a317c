"""Soft policy iteration on options, as `agents/hit_sac.py` does it, on exact tabular HiT-MDPs.

The oracle is soft value iteration on the augmented MDP, written as loops over its states (s, o) and
its actions (o, a); it knows nothing of options.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import logsumexp

from hitmdp_jax.agents import HitSAC
from tests.programs import compiled
from tests.theory import exact

from .strategies import random_hit_mdp

S, K, A = 3, 3, 2
CASES = [(1 / K, 0.7, 1.0), (0.9, 0.7, 1.0), (0.8, 0.4, 3.0)]  # stay, alpha_A, alpha_O / alpha_A
CLOSE = {"rtol": 0, "atol": 1e-8}


def hit_mdp(seed=0):
    hit = random_hit_mdp(seed, shape=(S, K, A))
    return dataclasses.replace(hit, information=np.zeros((S, K, K, A)), gamma=0.8)


def soft_values(hit, stay, action_weight, option_weight):
    """Return V [S, K] of the augmented MDP's best soft policy."""
    prior = np.where(np.eye(K, dtype=bool), stay, (1 - stay) / (K - 1))
    value = np.zeros((S, K))
    for _ in range(200):
        new = np.empty((S, K))
        for s in range(S):
            for before in range(K):
                worth = np.empty(K)
                for o in range(K):
                    q = [
                        hit.reward[s, a] + hit.gamma * hit.transition[s, a] @ value[:, o]
                        for a in range(A)
                    ]
                    of_action = action_weight * logsumexp(np.array(q) / action_weight)
                    worth[o] = of_action + option_weight * np.log(prior[before, o])
                new[s, before] = option_weight * logsumexp(worth / option_weight)
        value = new
    return value


@pytest.mark.parametrize(("stay", "weight", "ratio"), CASES)
def test_evaluation_and_improvement_converge_to_the_optimum_of_the_augmented_mdp(
    stay, weight, ratio
):
    hit = dataclasses.replace(
        hit_mdp(), option_entropy=ratio * weight, action_entropy=np.float64(weight)
    )
    prior = np.asarray(exact.sticky_prior(K, stay))
    _, history = exact.policy_iteration(exact.with_prior(hit, prior ** (ratio * weight)), 40)
    assert (np.diff(history.v_bar, axis=0) > -1e-9).all()  # no step makes a state worse
    best = soft_values(hit, stay, weight, ratio * weight)
    np.testing.assert_allclose(history.v_bar[-1], best, **CLOSE)


def agent_of(stay, weight, ratio):
    """The algorithm, and all that it reads of its parameters where tables replace networks."""
    log_weight = np.log(np.float64(weight))
    known = {"log_temperature": log_weight, "log_option_weight": log_weight + np.log(ratio)}
    return HitSAC(num_options=K, stay=stay), known


def target(agent, params, hit, q):
    """What `HitSAC.q_target` is in the mean, of tables Q [S, K, A] whose action policy is best."""
    weight = jnp.exp(params["log_temperature"])
    log_action = jax.nn.log_softmax(q / weight)
    q_option = (jnp.exp(log_action) * (q - weight * log_action)).sum(-1)
    value = agent.soft_value(params, None, q_option[:, None], jnp.arange(K))  # [S, K_prev]
    return hit.reward[:, None] + hit.gamma * jnp.einsum("sat,tk->ska", hit.transition, value)


@pytest.fixture(scope="module", params=CASES)
def learned(request):
    """A model, its weights, and where the algorithm's targets lead: V, Q and the master policy."""
    with jax.enable_x64(True):
        agent, params = agent_of(*request.param)
        hit, weight = hit_mdp(1), request.param[1]

        @compiled
        def run(q):
            q = jax.lax.fori_loop(0, 200, lambda _, q: target(agent, params, hit, q), q)
            q_option = weight * jax.nn.logsumexp(q / weight, axis=-1)[:, None]
            log_option = agent.master_log_probs(params, None, q_option, jnp.arange(K))
            value = agent.soft_value(params, None, q_option, jnp.arange(K))
            return value, q, jnp.exp(log_option)

        return hit, request.param, *run(np.random.default_rng(0).normal(size=(S, K, A)))


def test_the_algorithms_own_targets_lead_to_that_optimum(learned):
    hit, (stay, weight, ratio), value, _, _ = learned
    np.testing.assert_allclose(value, soft_values(hit, stay, weight, ratio * weight), **CLOSE)


def test_at_that_optimum_options_are_alike_and_the_master_follows_its_prior(learned):
    """It is the optimum without options: one reward gives no option anything to be better at."""
    hit, (stay, weight, _), _, q, master = learned
    flat = np.zeros((S, A))  # soft value iteration without options
    for _ in range(200):
        value = weight * logsumexp(flat / weight, axis=-1)
        flat = hit.reward + hit.gamma * hit.transition @ value
    np.testing.assert_allclose(q, flat[:, None].repeat(K, 1), **CLOSE)
    prior = np.asarray(exact.sticky_prior(K, stay))
    np.testing.assert_allclose(master, np.broadcast_to(prior, (S, K, K)), **CLOSE)


def test_the_critics_expected_direction_is_towards_the_soft_bellman_target():
    """The gradient of the expected loss over all that can follow, against the operator."""
    agent, params = agent_of(0.9, 0.7, 1.0)
    hit, q = hit_mdp(3), np.random.default_rng(0).normal(size=(S, K, A))
    visits = np.random.default_rng(1).dirichlet(np.ones(S * A)).reshape(S, A)

    @compiled
    def run(q):
        weight = jnp.exp(params["log_temperature"])
        q_option = weight * jax.nn.logsumexp(q / weight, axis=-1)
        value = agent.soft_value(params, None, q_option[:, None], jnp.arange(K))
        one = hit.reward[:, None, :, None] + hit.gamma * value.T[None, :, None]  # [S, K, A, S']

        def loss(q):
            error = 0.5 * jnp.square(q[..., None] - jax.lax.stop_gradient(one))
            return (visits[:, None, :, None] * hit.transition[:, None] * error).sum()

        return jax.grad(loss)(q), target(agent, params, hit, q)

    slope, aim = run(q)
    np.testing.assert_allclose(slope, visits[:, None] * (q - aim), **CLOSE)
