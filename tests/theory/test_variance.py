import dataclasses

import numpy as np
import pytest
from hypothesis import given

from hitmdp_jax.theory import (
    OptionModel,
    one_hot,
)
from tests.programs import compiled
from tests.theory import exact

from .strategies import (
    SHAPE,
    TINY,
    distributions,
    few,
    hit_mdps,
    option_models,
    random_hit_mdp,
    with_start,
)

S, K, _ = SHAPE


@few
@given(with_start(option_models(TINY), interior=True))
def test_proposition_3_4_v_bar_is_unbiased_for_the_mean_return_of_visits(drawn):
    # E[G_2 | s_2], the left side from enumerated SMDP trajectories and Q_O at their last step
    model, start = drawn
    hit, values = exact.hit_mdp(model), exact.evaluate(model)
    tau = exact.enumerate_trajectories(*TINY, 3)
    probability = exact.smdp_probability(model, exact.first_option(hit, start), tau)
    worth = values.q_option[tau.state[:, 2], tau.option[:, 2]]
    belief = exact.previous_option_belief(exact.visits(hit, start, 2))
    unbiased = exact.expected_value(values.v_bar, belief)
    for s in range(2):
        here = np.where(tau.state[:, 2] == s, probability, 0.0)
        if here.sum() > 0:
            mean_return = (here * worth).sum() / here.sum()
            np.testing.assert_allclose(mean_return, unbiased[s], rtol=1e-10, atol=1e-10)


def test_proposition_3_4_fails_for_the_value_of_eq_27():
    # State 0 always leads to state 1, which stays. There, option 0 earns 0 and option 1 earns 1 a
    # step. The master policy picks option 0 in state 0, would pick option 1 in state 1, but no
    # option terminates there: every visit to state 1 executes option 0.
    model = OptionModel(
        transition=np.broadcast_to([0.0, 1.0], (2, 2, 2)),
        reward=np.array([[0.0, 0.0], [0.0, 1.0]]),
        master=np.array([[1.0, 0.0], [0.0, 1.0]]),
        termination=np.array([[1.0, 0.0], [1.0, 0.0]]),
        action=np.broadcast_to(np.eye(2)[:, None], (2, 2, 2)),
        gamma=0.9,
    )
    values, hit = exact.evaluate(model), exact.hit_mdp(model)
    assert values.v[1] == pytest.approx(10.0)
    start = np.array([[0.5, 0.5], [0.0, 0.0]])
    for weights in (
        exact.visits(hit, start, 1),
        exact.visits(hit, start, 9),
        exact.occupancy(hit, start),
    ):
        mean_return = exact.expected_value(values.v_bar, exact.previous_option_belief(weights))
        assert mean_return[1] == pytest.approx(0.0)


@few
@given(option_models())
def test_both_values_agree_where_every_option_terminates(model):
    model = dataclasses.replace(model, termination=np.ones_like(model.termination))
    values = exact.evaluate(model)
    for belief in (np.full((S, K), 1 / K), np.eye(K)[:S]):
        np.testing.assert_allclose(
            exact.expected_value(values.v_bar, belief), values.v, rtol=1e-10, atol=1e-10
        )


def test_second_moment_by_enumeration():
    # gamma = 0.01: five steps hold all but 1e-10 of the return
    hit = random_hit_mdp(shape=TINY, gamma=0.01)
    tau = exact.enumerate_trajectories(*TINY, 5)
    squared = exact.discounted_return(hit.reward, hit.gamma, tau) ** 2
    tau_bar = compiled(one_hot, static_argnums=1)(tau, 2)
    second = np.asarray(exact.return_second_moment(hit))
    for s in range(2):
        for previous in range(2):
            start = np.zeros((2, 2))
            start[s, previous] = 1.0
            probability = exact.hit_mdp_probability(hit, exact.first_option(hit, start), tau_bar)
            assert float(probability @ squared) == pytest.approx(second[s, previous], abs=1e-9)


@few
@given(hit_mdps(interior=False), distributions(S, K))
def test_proposition_3_5_returns_scatter_no_more_around_v_bar(hit, belief):
    parts = exact.variance_decomposition(hit, belief)
    scale = 1e-9 * (1 + np.abs(np.asarray(exact.return_second_moment(hit))).max())
    np.testing.assert_allclose(parts.total, parts.within + parts.between, rtol=0, atol=scale)
    assert np.all(parts.within <= parts.total + scale)
    assert np.all(parts.within >= -scale)


@few
@given(hit_mdps(interior=False), distributions(S, K))
def test_proposition_3_5_is_strict_where_v_bar_tells_previous_options_apart(hit, belief):
    # belief's entries are 1/12 or more, or 0: a spread of V-bar shows in the variance
    v_bar = np.asarray(exact.hidden_values(hit).v_bar)
    parts = exact.variance_decomposition(hit, belief)
    for s in range(S):
        occurring = v_bar[s][np.asarray(belief[s]) > 0]
        spread = occurring.max() - occurring.min()
        reduction = float(parts.between[s])
        if spread > 1e-6:
            assert reduction > 1e-3 * spread**2
        else:
            assert reduction < 1e-12


def test_proposition_3_5_as_printed_is_the_wrong_way_round():
    # One state, two options that never terminate and earn 0 or 1: V-bar is 0 or 10, their mean is
    # 5. So Var(V-bar[s, o]) = 25 > 0 = Var(V[s]); the printed proof's first line swaps the two.
    model = OptionModel(
        transition=np.ones((1, 2, 1)),
        reward=np.array([[0.0, 1.0]]),
        master=np.array([[0.5, 0.5]]),
        termination=np.zeros((2, 1)),
        action=np.eye(2)[:, None],
        gamma=0.9,
    )
    parts = exact.variance_decomposition(exact.hit_mdp(model), np.array([[0.5, 0.5]]))
    assert parts.between[0] == pytest.approx(25.0)  # Var(V-bar), against Var(V) = 0
    assert parts.total[0] == pytest.approx(25.0)  # E (G - V)^2
    assert parts.within[0] == pytest.approx(0.0, abs=1e-9)  # E (G - V-bar)^2, the true claim
    assert exact.evaluate(model).v[0] == pytest.approx(5.0)


def test_belief_in_a_state_never_visited_is_uniform():
    belief = exact.previous_option_belief(np.array([[0.2, 0.6], [0.0, 0.0]]))
    np.testing.assert_allclose(belief, [[0.25, 0.75], [0.5, 0.5]])
