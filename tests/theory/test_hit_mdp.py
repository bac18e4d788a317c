"""The HiT-MDP's parts against their definitions, written as plain loops."""

import itertools

import jax
import numpy as np
from hypothesis import given

from hitmdp_jax.theory import hit_mdp, objective, occupancy
from hitmdp_jax.theory.hit_mdp import (
    augmented_reward,
    entropy,
    step_reward,
)
from tests.programs import compiled
from tests.theory import exact

from .strategies import SHAPE, few, hit_mdps, random_hit_mdp, with_start

S, K, A = SHAPE
rewards = compiled(lambda hit: (step_reward(hit), augmented_reward(hit)))
visits_and_worth = compiled(lambda hit, start: (occupancy(hit, start), objective(hit, start)))


def plain_entropy(policy):
    return -sum(p * np.log(p) for p in policy if p > 0)


def test_a_hit_mdp_is_its_own():
    hit = random_hit_mdp()
    assert hit_mdp(hit) is hit


def test_entropy_and_its_slope_are_finite_where_a_probability_is_zero():
    policies = np.array([[0.5, 0.5, 0.0], [0.0, 1.0, 0.0]])
    value, slope = compiled(lambda p: (entropy(p), jax.grad(lambda p: entropy(p).sum())(p)))(
        policies
    )
    np.testing.assert_allclose(value, [np.log(2), 0.0], atol=1e-15)
    np.testing.assert_allclose(slope, [[np.log(2) - 1] * 2 + [0.0], [0.0, -1.0, 0.0]], atol=1e-15)


@few
@given(hit_mdps(interior=False))
def test_rewards_add_up_the_four_terms(hit):
    step, augmented = rewards(hit)
    expected = np.zeros((S, K))
    for s, p, o, a in itertools.product(range(S), range(K), range(K), range(A)):
        reward = (
            hit.reward[s, a]
            + hit.information[s, p, o, a]
            + hit.option_entropy * plain_entropy(hit.master[s, p])
            + hit.action_entropy * plain_entropy(hit.action[o, s])
        )
        np.testing.assert_allclose(step[s, p, o, a], reward, atol=1e-12)
        expected[s, p] += hit.master[s, p, o] * hit.action[o, s, a] * reward
    np.testing.assert_allclose(augmented, expected, atol=1e-12)


@few
@given(hit_mdps(interior=False))
def test_the_augmented_chain_remembers_the_option(hit):
    chain = exact.augmented_transition(hit)
    for s, p, t, o in itertools.product(range(S), range(K), range(S), range(K)):
        expected = hit.master[s, p, o] * (hit.action[o, s] @ hit.transition[s, :, t])
        np.testing.assert_allclose(chain[s, p, t, o], expected, atol=1e-14)
    np.testing.assert_allclose(chain.sum((2, 3)), 1.0, atol=1e-14)


@few
@given(with_start(hit_mdps(interior=False)))
def test_visits_are_the_discounted_sum_over_time_and_earn_the_objective(drawn):
    hit, start = drawn
    chain, now, total = exact.augmented_transition(hit), start, np.zeros((S, K))
    for t in range(int(25 / (1 - hit.gamma))):  # gamma^t < 1e-10 by then
        total += hit.gamma**t * now
        now = np.einsum("sp,spto->to", now, chain)
    visits, worth = visits_and_worth(hit, start)
    np.testing.assert_allclose(visits, total, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(worth, (visits * rewards(hit)[1]).sum(), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        worth, (start * exact.hidden_values(hit).v_bar).sum(), rtol=1e-12, atol=1e-12
    )
