import dataclasses
import functools
import itertools

import jax
import numpy as np
from hypothesis import given

from hitmdp_jax.theory import (
    HiddenTrajectory,
    call_and_return_probability,
    discounted_return,
    enumerate_trajectories,
    evaluate_by_iteration,
    first_option,
    hit_mdp,
    hit_mdp_probability,
    initiable_master_policy,
    markovian_option_value,
    one_hot,
    partition,
    smdp_probability,
)
from tests.programs import compiled

from .strategies import TINY, few, option_models, random_option_model, with_start

LENGTH = 3
smdp_probable = compiled(smdp_probability)
hidden_probable = compiled(hit_mdp_probability)
called_probable = compiled(call_and_return_probability)
returns = compiled(discounted_return)
as_hidden = compiled(hit_mdp)
first_drawn = compiled(first_option)
initiable = compiled(initiable_master_policy)
unpartitioned = compiled(one_hot, static_argnums=1)
partitioned = compiled(partition)
option_value = compiled(markovian_option_value)
every = compiled(enumerate_trajectories, static_argnums=(0, 1, 2, 3))
iterate = compiled(evaluate_by_iteration)


@functools.cache
def every_trajectory():
    tau = every(*TINY, LENGTH)
    return tau, unpartitioned(tau, TINY[1])


@few
@given(with_start(option_models(TINY)))
def test_theorem_3_1_trajectories_are_equally_likely_in_both_processes(drawn):
    model, first = drawn
    tau, tau_bar = every_trajectory()
    smdp = smdp_probable(model, first, partitioned(tau_bar))
    hidden = hidden_probable(as_hidden(model), first, tau_bar)
    np.testing.assert_allclose(smdp, hidden, rtol=0, atol=1e-12)
    np.testing.assert_allclose([smdp.sum(), hidden.sum()], 1.0, atol=1e-12)
    assert np.all(partitioned(tau_bar).option == tau.option)


@few
@given(with_start(option_models(TINY)))
def test_theorem_3_1_expected_returns_are_equal(drawn):
    model, first = drawn
    _, tau_bar = every_trajectory()
    tau = partitioned(tau_bar)
    smdp = smdp_probable(model, first, tau) @ returns(model.reward, model.gamma, tau)
    hidden = hidden_probable(as_hidden(model), first, tau_bar) @ returns(
        model.reward, model.gamma, tau_bar
    )
    np.testing.assert_allclose(smdp, hidden, rtol=0, atol=1e-12)
    # and both are LENGTH applications of the Hidden Temporal Bellman operator
    q_action = iterate(model, LENGTH)
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
        total += called_probable(model, first, tau, b)
    np.testing.assert_allclose(total, smdp_probable(model, first, tau), rtol=0, atol=1e-12)


def test_forgetting_terminations_is_many_to_one():
    # an option that terminates and is picked again looks like one that goes on
    model = random_option_model(shape=TINY)
    first = np.full((2, 2), 0.25)
    tau, _ = every_trajectory()
    same = jax.tree.map(lambda x: x[:1], tau)  # o_0 = o_1 = o_2
    for terminated in itertools.product((0, 1), repeat=LENGTH - 1):
        assert called_probable(model, first, same, np.array([terminated]))[0] > 0


def test_partition_is_a_bijection_on_one_hot_vectors_only():
    tau = every(1, 3, 1, 2)
    tau_bar = unpartitioned(tau, 3)
    images = {tuple(row) for row in np.asarray(partitioned(tau_bar).option)}
    assert len(images) == len(tau.option) == 9
    # O-bar = {0, 1}^K as printed is larger: with d = (1, 2, 3), 110 and 001 both give 3.
    d = np.array([1, 2, 3])
    assert np.array([1, 1, 0]) @ d == np.array([0, 0, 1]) @ d


def test_eq_2_products_of_powers_pick_the_active_option():
    model = random_option_model(shape=(2, 3, 2))
    tau = every(2, 3, 2, 1)
    tau_bar = unpartitioned(tau, 3)
    probability = hidden_probable(as_hidden(model), np.ones((2, 3)), tau_bar)
    expected = model.action[tau.option, tau.state, tau.action].squeeze(-1)
    np.testing.assert_allclose(probability, expected, rtol=1e-14)


def test_eq_16_and_eq_26_start_alike_only_if_the_first_option_is_matched():
    # Eq. 16 draws the first option from P(o_0); Eq. 26 draws o_0 as a PREVIOUS option, and the
    # Markovian master policy may keep it. With options that never terminate it always does.
    model = random_option_model(shape=TINY)
    model = dataclasses.replace(model, termination=np.zeros((2, 2)))
    state = np.array([0.5, 0.5])
    called = state[:, None] * initiable(model)  # the SMDP's own start
    kept = first_drawn(as_hidden(model), state[:, None] * np.full((2, 2), 0.5))
    np.testing.assert_allclose(kept, 0.25)
    assert np.abs(called - kept).max() > 0.05
    terminating = dataclasses.replace(model, termination=np.ones((2, 2)))
    matched = first_drawn(as_hidden(terminating), state[:, None] * np.full((2, 2), 0.5))
    np.testing.assert_allclose(matched, called, atol=1e-15)


@few
@given(with_start(option_models(TINY)))
def test_returns_from_a_previous_option_are_v_bar(drawn):
    model, start = drawn
    hit = as_hidden(model)
    _, tau_bar = every_trajectory()
    probability = hidden_probable(hit, first_drawn(hit, start), tau_bar)
    enumerated = probability @ returns(model.reward, model.gamma, tau_bar)
    v_bar = option_value(hit, iterate(model, LENGTH))
    np.testing.assert_allclose(enumerated, (start * v_bar).sum(), rtol=0, atol=1e-12)


def test_probabilities_take_any_batch_shape():
    model, first = random_option_model(shape=TINY), np.full((2, 2), 0.25)
    _, tau_bar = every_trajectory()
    flat = hidden_probable(as_hidden(model), first, tau_bar)
    folded = HiddenTrajectory(
        *(x.reshape(8, 64, *x.shape[1:]) for x in (tau_bar.state, tau_bar.option, tau_bar.action))
    )
    np.testing.assert_array_equal(hidden_probable(as_hidden(model), first, folded).ravel(), flat)
