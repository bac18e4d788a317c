import dataclasses
import functools
import itertools

import jax
import numpy as np
from hypothesis import given

from hitmdp_jax.theory import (
    HiddenTrajectory,
)
from tests.theory import exact

from .strategies import TINY, few, option_models, random_option_model, with_start

LENGTH = 3


@functools.cache
def every_trajectory():
    tau = exact.enumerate_trajectories(*TINY, LENGTH)
    return tau, exact.one_hot(tau, TINY[1])


@few
@given(with_start(option_models(TINY)))
def test_theorem_3_1_trajectories_are_equally_likely_in_both_processes(drawn):
    model, first = drawn
    tau, tau_bar = every_trajectory()
    smdp = exact.smdp_probability(model, first, exact.partition(tau_bar))
    hidden = exact.hit_mdp_probability(exact.hit_mdp(model), first, tau_bar)
    np.testing.assert_allclose(smdp, hidden, rtol=0, atol=1e-12)
    np.testing.assert_allclose([smdp.sum(), hidden.sum()], 1.0, atol=1e-12)
    assert np.all(exact.partition(tau_bar).option == tau.option)


@few
@given(with_start(option_models(TINY)))
def test_theorem_3_1_expected_returns_are_equal(drawn):
    model, first = drawn
    _, tau_bar = every_trajectory()
    tau = exact.partition(tau_bar)
    smdp = exact.smdp_probability(model, first, tau) @ exact.discounted_return(
        model.reward, model.gamma, tau
    )
    hidden = exact.hit_mdp_probability(
        exact.hit_mdp(model), first, tau_bar
    ) @ exact.discounted_return(model.reward, model.gamma, tau_bar)
    np.testing.assert_allclose(smdp, hidden, rtol=0, atol=1e-12)
    # and both are LENGTH applications of the Hidden Temporal Bellman operator
    q_action = exact.evaluate_by_iteration(model, LENGTH)
    by_operator = np.einsum("so,osa,soa->", first, model.action, q_action)
    np.testing.assert_allclose(smdp, by_operator, rtol=0, atol=1e-12)


@few
@given(with_start(option_models(TINY)))
def test_eq_24_summed_over_terminations_is_eq_16(drawn):
    model, first = drawn
    tau, _ = every_trajectory()
    total = np.zeros(len(tau.state))
    for terminated in itertools.product((0, 1), repeat=LENGTH - 1):
        b = np.broadcast_to(np.array(terminated), (len(tau.state), LENGTH - 1))
        total += exact.call_and_return_probability(model, first, tau, b)
    np.testing.assert_allclose(total, exact.smdp_probability(model, first, tau), rtol=0, atol=1e-12)


def test_forgetting_terminations_is_many_to_one():
    # an option that terminates and is picked again looks like one that goes on
    model = random_option_model(shape=TINY)
    first = np.full((2, 2), 0.25)
    tau, _ = every_trajectory()
    same = jax.tree.map(lambda x: x[:1], tau)  # o_0 = o_1 = o_2
    for terminated in itertools.product((0, 1), repeat=LENGTH - 1):
        assert exact.call_and_return_probability(model, first, same, np.array([terminated]))[0] > 0


def test_partition_is_a_bijection_on_one_hot_vectors_only():
    tau = exact.enumerate_trajectories(1, 3, 1, 2)
    tau_bar = exact.one_hot(tau, 3)
    images = {tuple(row) for row in np.asarray(exact.partition(tau_bar).option)}
    assert len(images) == len(tau.option) == 9
    # O-bar = {0, 1}^K as printed is larger: with d = (1, 2, 3), 110 and 001 both give 3.
    d = np.array([1, 2, 3])
    assert np.array([1, 1, 0]) @ d == np.array([0, 0, 1]) @ d


def test_eq_2_products_of_powers_pick_the_active_option():
    model = random_option_model(shape=(2, 3, 2))
    tau = exact.enumerate_trajectories(2, 3, 2, 1)
    tau_bar = exact.one_hot(tau, 3)
    probability = exact.hit_mdp_probability(exact.hit_mdp(model), np.ones((2, 3)), tau_bar)
    expected = model.action[tau.option, tau.state, tau.action].squeeze(-1)
    np.testing.assert_allclose(probability, expected, rtol=1e-14)


def test_eq_16_and_eq_26_start_alike_only_if_the_first_option_is_matched():
    # Eq. 16 draws the first option from P(o_0); Eq. 26 draws o_0 as a PREVIOUS option, and the
    # Markovian master policy may keep it. With options that never terminate it always does.
    model = random_option_model(shape=TINY)
    model = dataclasses.replace(model, termination=np.zeros((2, 2)))
    state = np.array([0.5, 0.5])
    called = state[:, None] * exact.initiable_master_policy(model)  # the SMDP's own start
    kept = exact.first_option(exact.hit_mdp(model), state[:, None] * np.full((2, 2), 0.5))
    np.testing.assert_allclose(kept, 0.25)
    assert np.abs(called - kept).max() > 0.05
    terminating = dataclasses.replace(model, termination=np.ones((2, 2)))
    matched = exact.first_option(exact.hit_mdp(terminating), state[:, None] * np.full((2, 2), 0.5))
    np.testing.assert_allclose(matched, called, atol=1e-15)


@few
@given(with_start(option_models(TINY)))
def test_returns_from_a_previous_option_are_v_bar(drawn):
    model, start = drawn
    hit = exact.hit_mdp(model)
    _, tau_bar = every_trajectory()
    probability = exact.hit_mdp_probability(hit, exact.first_option(hit, start), tau_bar)
    enumerated = probability @ exact.discounted_return(model.reward, model.gamma, tau_bar)
    v_bar = exact.markovian_option_value(hit, exact.evaluate_by_iteration(model, LENGTH))
    np.testing.assert_allclose(enumerated, (start * v_bar).sum(), rtol=0, atol=1e-12)


def test_probabilities_take_any_batch_shape():
    model, first = random_option_model(shape=TINY), np.full((2, 2), 0.25)
    _, tau_bar = every_trajectory()
    flat = exact.hit_mdp_probability(exact.hit_mdp(model), first, tau_bar)
    folded = HiddenTrajectory(
        *(x.reshape(8, 64, *x.shape[1:]) for x in (tau_bar.state, tau_bar.option, tau_bar.action))
    )
    np.testing.assert_array_equal(
        exact.hit_mdp_probability(exact.hit_mdp(model), first, folded).ravel(), flat
    )
