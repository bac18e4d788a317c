import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from scipy.special import logsumexp

from hitmdp_jax.theory import (
    HiTMDP,
    optimality_operator,
)
from tests.theory import exact

from .strategies import SHAPE, distributions, few, hit_mdps, random_hit_mdp, tables

S, K, A = SHAPE


@jax.jit
def optimum(hit):
    """Q_A after many steps of value iteration."""
    return jax.lax.fori_loop(
        0, 4000, lambda _, q: optimality_operator(hit, q), jnp.zeros((S, K, A))
    )


def separable(hit, f, g):
    """Give the HiT-MDP I(o | s, a, o_prev) = f(s, o, a) + g(s, o_prev, o)."""
    return dataclasses.replace(hit, information=f[:, None] + g[..., None])


@few
@given(hit_mdps(interior=False), tables(S, K, A), tables(S, K, K))
def test_theorem_e_2_values_never_fall(hit, f, g):
    hit = separable(hit, f, g)
    _, history = exact.policy_iteration(hit, 6)
    for values in (history.v_bar, history.q_action):
        rise = np.diff(np.asarray(values), axis=0)
        assert rise.min() >= -1e-8 * (1 + np.abs(values).max())


@few
@given(
    hit_mdps(interior=False),
    tables(S, K, A),
    tables(S, K, K),
    distributions(S, K, K),
    distributions(K, S, A),
)
def test_theorem_e_2_converges_to_the_best_policies(hit, f, g, master, action):
    hit = separable(hit, f, g)
    best, _ = exact.policy_iteration(hit, 40)
    reached = exact.hidden_values(best).q_action
    np.testing.assert_allclose(reached, optimum(hit), rtol=1e-6, atol=1e-6)
    other = exact.hidden_values(dataclasses.replace(hit, master=master, action=action)).q_action
    assert np.all(other <= reached + 1e-6)


def test_soft_optimum_is_the_log_sum_exp_recursion():
    rng = np.random.default_rng(3)
    f, g = np.asarray(rng.normal(size=(S, K, A))), np.asarray(rng.normal(size=(S, K, K)))
    hit = separable(random_hit_mdp(1, option_entropy=1.0, action_entropy=1.0), f, g)
    q = exact.hidden_values(exact.policy_iteration(hit, 40)[0]).q_action
    v_bar = logsumexp(logsumexp(q + f, axis=-1)[:, None] + g, axis=-1)
    again = hit.reward[:, None] + hit.gamma * np.einsum("sat,to->soa", hit.transition, v_bar)
    np.testing.assert_allclose(again, q, rtol=1e-9)


def test_without_information_the_best_master_policy_forgets_the_option():
    hit = random_hit_mdp(2, option_entropy=0.3, action_entropy=0.3)
    best, _ = exact.policy_iteration(hit, 40)
    assert np.abs(hit.master - hit.master[:, :1]).max() > 0.1
    np.testing.assert_allclose(best.master, best.master[:, :1].repeat(K, 1), atol=1e-9)


def test_a_bonus_for_staying_makes_options_persist():
    hit = random_hit_mdp(2, information=5.0 * np.eye(K)[None, :, :, None])
    best, _ = exact.policy_iteration(hit, 40)
    np.testing.assert_allclose(best.master, np.broadcast_to(np.eye(K), (S, K, K)), atol=1e-9)


def test_ties_are_shared_evenly():
    hit = dataclasses.replace(random_hit_mdp(), reward=np.zeros((S, A)))
    even = exact.improve(hit)
    np.testing.assert_allclose(even.action, 1 / A)
    np.testing.assert_allclose(even.master, 1 / K)


def conflict(prefer_first):
    """One state, gamma 0; only option 0 is worth taking, and its best action depends on o_prev."""
    information = np.full((1, 2, 2, 2), -9.0)
    information[0, 0, 0], information[0, 1, 0] = [1.0, 0.0], [0.0, 1.0]
    return HiTMDP(
        transition=np.ones((1, 2, 1)),
        reward=np.zeros((1, 2)),
        master=np.broadcast_to(np.array([1.0, 0.0]), (1, 2, 2)),
        action=np.array([[[prefer_first, 1 - prefer_first]], [[0.5, 0.5]]]),
        gamma=0.0,
        information=information,
    )


def test_theorem_e_2_needs_an_information_that_splits():
    # V-bar[., 0] = p and V-bar[., 1] = 1 - p for p = pi_A(0 | option 0): what helps one augmented
    # state hurts the other, so no policy is best for all of them, and improvement cannot be either.
    for p in (0.0, 0.3, 1.0):
        np.testing.assert_allclose(
            exact.hidden_values(conflict(p)).v_bar[0], [p, 1 - p], atol=1e-12
        )
    before, after = conflict(0.9), exact.improve(conflict(0.9))
    fall = exact.hidden_values(after).v_bar - exact.hidden_values(before).v_bar
    assert fall.min() < -0.3


def test_theorem_e_2_holds_with_equality_for_other_policies_too():
    # printed: Q* > Q for every other policy and everywhere. State 1 is for ever; what a policy does
    # in state 0 is nothing to it.
    hit = HiTMDP(
        transition=np.broadcast_to([0.0, 1.0], (2, 2, 2)),
        reward=np.array([[0.0, 1.0], [0.0, 1.0]]),
        master=np.ones((2, 1, 1)),
        action=np.array([[[0.0, 1.0], [0.0, 1.0]]]),
        gamma=0.9,
    )
    worse = dataclasses.replace(hit, action=np.array([[[1.0, 0.0], [0.0, 1.0]]]))
    assert exact.hidden_values(worse).v_bar[0, 0] == pytest.approx(9.0)
    assert exact.hidden_values(hit).v_bar[0, 0] == pytest.approx(10.0)
    np.testing.assert_array_equal(
        exact.hidden_values(worse).q_action, exact.hidden_values(hit).q_action
    )
