import jax
import numpy as np
import pytest

from hitmdp_jax.learning.options import (
    OptionMemory,
    at_option,
    even_weights,
    mean_duration,
    option_statistics,
    option_transition,
    termination_objective,
    value_of_next_option,
)
from hitmdp_jax.theory import evaluate, hit_mdp, markovian_master_policy, objective, occupancy
from tests.programs import compiled
from tests.theory.strategies import random_option_model

S, K = 2, 3  # of random_option_model

transition = compiled(option_transition)


def test_counts_of_a_hand_written_sequence():
    #                 0  0  1  1 | 1  0   an episode starts at index 4
    option = np.array([0, 0, 1, 1, 1, 0])[:, None]
    previous = np.array([2, 0, 0, 1, 1, 1])[:, None]
    started = np.array([1, 0, 0, 0, 1, 0], bool)[:, None]
    counts = compiled(option_statistics, static_argnames="num_options")(
        option, previous, started, num_options=3
    )
    np.testing.assert_array_equal(counts["option_steps"], [3, 3, 0])
    # option 0: at the start and at the end; option 1: at its switch and at the new episode.
    np.testing.assert_array_equal(counts["option_activations"], [2, 2, 0])
    assert mean_duration(counts["option_steps"].sum(), counts["option_activations"].sum()) == 1.5


def test_an_option_that_ran_throughout_counts_once():
    assert mean_duration(np.array(2048.0), np.array(0.0)) == 2048


def test_an_option_that_never_ran_has_no_duration():
    assert np.isnan(mean_duration(np.array(0.0), np.array(0.0)))


def logit(p):
    return np.log(p) - np.log1p(-p)


def test_option_transition_equals_eq_22():
    model = random_option_model()
    expected = compiled(markovian_master_policy)(model)  # [S, K_prev, K]
    s, previous = np.meshgrid(np.arange(S), np.arange(K), indexing="ij")
    result = transition(np.log(model.master)[s], logit(model.termination)[previous, s], previous)
    np.testing.assert_allclose(np.exp(result), expected, rtol=1e-5)


@pytest.mark.parametrize("termination", [-200.0, 200.0])
def test_option_transition_is_exact_and_differentiable_at_extremes(termination):
    log_master = np.log(np.array([0.2, 0.8]))

    @compiled
    @jax.value_and_grad
    def taken(logits, option):
        return option_transition(log_master, logits, 0)[option]

    going_on = termination < 0
    expected = [0.0, termination + log_master[1]] if going_on else log_master
    for option in range(2):
        value, slope = taken(termination, option)
        np.testing.assert_allclose(value, expected[option], rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(slope, 1.0 if going_on and option == 1 else 0.0, atol=1e-6)


def test_termination_objective_descends_along_the_exact_gradient():
    """Summed over discounted visits its slope is -dJ/dtheta, by autodiff of the exact values."""
    model = random_option_model()
    logits = logit(model.termination)  # [K, S]
    start = np.full((S, K), 1 / (S * K))

    def value(logits):
        return objective(hit_mdp(model.replace(termination=jax.nn.sigmoid(logits))), start)

    values, visited = compiled(lambda m: (evaluate(m), occupancy(hit_mdp(m), start).ravel()))(model)
    s, previous = (x.ravel() for x in np.meshgrid(np.arange(S), np.arange(K), indexing="ij"))
    memory = OptionMemory(previous, np.zeros(S * K, bool))

    def estimate(logits):
        terms = termination_objective(
            logits.T[s], values.q_option[s], values.v[s], memory, regularizer=0.0
        )
        return (visited * terms).sum()

    slopes = compiled(lambda x: (jax.grad(estimate)(x), -jax.grad(value)(x)))
    np.testing.assert_allclose(*slopes(logits), rtol=1e-3)


def test_termination_objective_is_by_hand():
    q = np.array([[1.0, 3.0], [1.0, 3.0]])
    memory = OptionMemory(np.array([1, 1]), np.array([False, True]))
    result = compiled(termination_objective)(np.zeros((2, 2)), q, np.array([2.5, 2.5]), memory, 0.1)
    # 1/2 (3 - 2.5 + 0.1); nothing at an episode's start.
    np.testing.assert_allclose(result, [0.3, 0.0], rtol=1e-6)


def test_the_next_options_value_is_its_own_where_it_was_drawn():
    q = np.array([[[1.0, 2.0]], [[3.0, 4.0]], [[5.0, 6.0]]])
    even = np.log(np.full_like(q, 0.5))
    option = np.array([[0], [1], [0]])
    ended = np.array([[False], [True], [False]])
    # Drawn: option 1 in the first state reached; the episode, then the rollout, ended: means.
    result = compiled(value_of_next_option)(q, even, option, ended)
    np.testing.assert_allclose(result[:, 0], [2.0, 3.5, 5.5], rtol=1e-6)


def test_an_infinity_elsewhere_does_no_harm():
    values = np.array([-np.inf, 2.0])
    value, slope = compiled(jax.value_and_grad(at_option))(values, 1)
    assert value == 2.0
    np.testing.assert_array_equal(slope, [0.0, 1.0])


def test_under_even_weights_each_option_counts_the_same():
    """Also one that is rare, as long as it has two steps of a hundred."""
    option = np.repeat([0, 1, 2, 3], [150, 40, 6, 4]).reshape(2, 100)
    weights = np.asarray(even_weights(option, 4))
    np.testing.assert_allclose([weights[option == k].sum() for k in range(4)], 50.0, rtol=1e-5)
    rare = np.repeat([0, 1], [99, 1])[None]
    np.testing.assert_allclose(even_weights(rare, 2)[0, -1], 1 / (2 * 0.02), rtol=1e-5)
    np.testing.assert_allclose(even_weights(np.zeros((1, 9), int), 4), 0.25, rtol=1e-5)
