import dataclasses

import jax
import numpy as np
import pytest
from hypothesis import given

from hitmdp_jax import UsageError
from hitmdp_jax.theory import (
    check,
    evaluate,
    markovian_master_policy,
)
from tests.theory import exact

from .strategies import few, option_models, random_option_model


@few
@given(option_models())
def test_eq_22_is_a_distribution_and_agrees_with_a_loop(model):
    policy = np.asarray(exact.markovian_master_policy(model))
    num_states, num_options = model.master.shape
    for s in range(num_states):
        for before in range(num_options):
            beta = float(model.termination[before, s])
            for now in range(num_options):
                expected = (1 - beta) * (now == before) + beta * float(model.master[s, now])
                assert policy[s, before, now] == pytest.approx(expected, abs=1e-14)
    np.testing.assert_allclose(policy.sum(-1), 1.0, atol=1e-14)


def test_mixture_master_policy_goes_on_or_picks_anew():
    model = random_option_model()
    go_on, pick = exact.mixture_master_policy(model)
    np.testing.assert_array_equal(go_on, np.broadcast_to(np.eye(3), go_on.shape))
    np.testing.assert_array_equal(pick[:, 0], model.master)
    np.testing.assert_array_equal(pick[:, 1], model.master)


@few
@given(option_models())
def test_an_smdp_persists_with_trace_at_least_one(model):
    # sum_k (1 - beta_k) + beta_k mu_k = K - sum_k beta_k (1 - mu_k) >= K - (K - 1)
    trace = np.trace(exact.markovian_master_policy(model), axis1=1, axis2=2)
    assert float(trace.min()) >= 1 - 1e-12
    alternation = np.eye(2)[::-1]
    assert np.trace(alternation) == 0  # so this HiT-MDP master policy is no SMDP's


def test_initiation_sets_bar_starting_but_not_continuing():
    model = random_option_model()
    initiation = np.array([[True, True], [False, True], [False, True]])  # only 0 in state 0
    barred = dataclasses.replace(model, initiation=initiation)
    assert exact.initiable_master_policy(barred)[0].tolist() == [1.0, 0.0, 0.0]
    np.testing.assert_allclose(
        exact.initiable_master_policy(barred)[1:], model.master[1:], rtol=1e-14
    )
    policy = exact.markovian_master_policy(barred)
    assert policy[0, 0, 1] == 0
    assert policy[0, 1, 1] == pytest.approx(1 - float(model.termination[1, 0]))
    np.testing.assert_allclose(policy.sum(-1), 1.0, atol=1e-14)


def test_initiation_sets_of_all_states_change_nothing():
    model = random_option_model()
    everywhere = dataclasses.replace(model, initiation=np.ones((3, 2), bool))
    np.testing.assert_allclose(
        exact.evaluate(everywhere).v_bar, exact.evaluate(model).v_bar, rtol=1e-13
    )


def test_check_accepts_a_valid_model():
    model = random_option_model()
    assert check(model) is model


@pytest.mark.parametrize("concentration", [0.1, 1.0])
def test_sampled_models_are_valid(key, concentration):
    model = check(exact.sample_option_model(key, 5, 3, 2, 0.9, concentration))
    assert {x.dtype for x in jax.tree.leaves(model)[:-1]} == {np.dtype("float64")}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"reward": np.zeros(3)}, "reward must be"),
        ({"termination": np.zeros((2, 3))}, r"termination has shape \(2, 3\)"),
        ({"master": np.full((2, 3), 0.3)}, "row of master sums to 0.9"),
        ({"transition": np.full((2, 4, 2), 0.75)}, "row of transition sums to 1.5"),
        ({"termination": np.full((3, 2), 1.5)}, "termination has entries outside"),
        ({"gamma": 1.0}, "gamma is 1"),
        ({"initiation": np.zeros((3, 2), bool)}, "no option that may start"),
    ],
)
def test_check_explains_what_is_wrong(change, message):
    with pytest.raises(UsageError, match=message):
        check(dataclasses.replace(random_option_model(), **change))


def types(model):
    """The types of everything that is computed, found out by tracing alone."""
    results = jax.eval_shape(lambda x: (evaluate(x), markovian_master_policy(x)), model)
    return {x.dtype for x in jax.tree.leaves(results)}


def test_float32_without_x64_and_float64_with_it():
    arrays = jax.tree.map(np.asarray, random_option_model())
    assert types(arrays) == {np.dtype("float64")}
    narrow = jax.tree.map(lambda x: np.asarray(x, np.float32), arrays)
    assert types(narrow) == {np.dtype("float64")}
    with jax.enable_x64(False):
        assert types(arrays) == {np.dtype("float32")}
