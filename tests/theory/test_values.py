import dataclasses

import jax
import numpy as np
import pytest
from hypothesis import given

from hitmdp_jax.theory import (
    HiTMDP,
    evaluate,
    markovian_option_value,
)
from hitmdp_jax.theory.hit_mdp import option_action_value
from tests.programs import compiled
from tests.theory import exact

from .strategies import (
    SHAPE,
    few,
    hit_mdps,
    option_models,
    random_hit_mdp,
    random_option_model,
    tables,
)

S, K, A = SHAPE
operate_on_v_bar = compiled(
    lambda hit, v_bar: markovian_option_value(hit, option_action_value(hit, v_bar))
)


def sup_norm(x):
    return float(np.abs(x).max())


@few
@given(option_models())
def test_theorem_3_2_values_are_the_operators_fixed_point(model):
    values = exact.evaluate(model)
    again = exact.bellman_operator(model, values.q_action)
    np.testing.assert_allclose(again, values.q_action, rtol=1e-10, atol=1e-10)


@few
@given(option_models())
def test_eq_6_v_bar_averages_action_values(model):
    values, policy = exact.evaluate(model), exact.hit_mdp(model).master
    q_option = np.einsum("ksa,ska->sk", model.action, values.q_action)  # Eq. 28
    np.testing.assert_allclose(values.q_option, q_option, rtol=1e-10, atol=1e-10)
    v_bar = np.einsum("spo,so->sp", policy, q_option)
    np.testing.assert_allclose(values.v_bar, v_bar, rtol=1e-10, atol=1e-10)
    v = (model.master * q_option).sum(-1)  # Eq. 27
    np.testing.assert_allclose(values.v, v, rtol=1e-10, atol=1e-10)


@few
@given(option_models())
def test_proposition_d_1_4_value_upon_arrival_is_v_bar(model):
    arrival = exact.option_value_upon_arrival(model)
    np.testing.assert_allclose(arrival, exact.evaluate(model).v_bar, rtol=1e-10, atol=1e-10)


@few
@given(hit_mdps(interior=False), tables(S, K, A), tables(S, K, A))
def test_theorem_3_3_operator_contracts_by_gamma(hit, q, other):
    before = sup_norm(q - other)
    after = sup_norm(
        exact.hidden_temporal_operator(hit, q) - exact.hidden_temporal_operator(hit, other)
    )
    assert after <= float(hit.gamma) * before + 1e-12


@few
@given(hit_mdps(interior=False), tables(S, K), tables(S, K))
def test_theorem_3_3_contraction_over_augmented_states(hit, v_bar, other):
    # the form of Eq. 40-42: V-bar -> Q_A -> V-bar, sup norm over (s, o_prev)
    after = sup_norm(operate_on_v_bar(hit, v_bar) - operate_on_v_bar(hit, other))
    assert after <= float(hit.gamma) * sup_norm(v_bar - other) + 1e-12


@few
@given(hit_mdps(interior=False), tables(S, K, A))
def test_factor_gamma_is_tight(hit, q):
    # a constant is discounted once: no factor below gamma, such as the gamma^2 that the third
    # line of Eq. 42 prints, holds for all pairs
    shifted = exact.hidden_temporal_operator(hit, q + 8.0) - exact.hidden_temporal_operator(hit, q)
    np.testing.assert_allclose(shifted, 8.0 * hit.gamma, atol=1e-12)


@few
@given(hit_mdps(interior=False))
def test_theorem_3_3_iteration_converges_to_the_linear_solve(hit):
    fixed_point = exact.hidden_values(hit).q_action
    q = np.full_like(fixed_point, 7.0)
    error = sup_norm(q - fixed_point)
    for n in (1, 10, 100):
        after = sup_norm(exact.evaluate_by_iteration(hit, n, q) - fixed_point)
        assert after <= float(hit.gamma) ** n * error + 1e-9


@few
@given(hit_mdps(interior=False))
def test_theorem_3_3_distances_stay_below_gamma_to_the_n(hit):
    distances = np.asarray(exact.distances_to_fixed_point(hit, 20))
    bound = distances[0] * float(hit.gamma) ** np.arange(21)
    assert np.all(distances <= bound + 1e-9)
    after = sup_norm(exact.evaluate_by_iteration(hit, 5) - exact.hidden_values(hit).q_action)
    assert distances[5] == pytest.approx(after, abs=1e-12)


def test_iteration_finds_the_policys_value_not_the_optimal_one():
    # one state, two actions worth 0 and 1, an option that always takes the first
    model = dataclasses.replace(
        random_option_model(shape=(1, 1, 2), gamma=0.5),
        reward=np.array([[0.0, 1.0]]),
        action=np.array([[[1.0, 0.0]]]),
    )
    np.testing.assert_allclose(exact.evaluate_by_iteration(model, 60)[0, 0], [0.0, 1.0], atol=1e-12)
    assert exact.evaluate(model).v[0] == 0.0  # the optimal value is 1 / (1 - 0.5) = 2


def test_eq_7_as_printed_counts_the_first_reward_twice():
    # state 0 pays 1 and leads to state 1, which pays nothing for ever: G = 1
    hit = HiTMDP(
        transition=np.array([[[0.0, 1.0]], [[0.0, 1.0]]]),
        reward=np.array([[1.0], [0.0]]),
        master=np.ones((2, 1, 1)),
        action=np.ones((1, 2, 1)),
        gamma=0.9,
    )
    assert exact.hidden_values(hit).q_action[0, 0, 0] == pytest.approx(1.0)
    rewards = np.array([1.0, 0.0, 0.0])  # r_{t+1}, r_{t+2}, r_{t+3}
    printed = 1.0 + sum(0.9**n * rewards[n - 1] for n in (1, 2, 3))  # r + sum_l gamma^l r_{t+l}
    right = 1.0 + sum(0.9**n * rewards[n] for n in (1, 2))  # r + sum_l gamma^l r_{t+l+1}
    assert (printed, right) == (1.9, 1.0)


def test_eq_41_reward_cannot_leave_the_expectation():
    # r(s, a) has no value outside a sum over a: V-bar(s0) = E[r] = 0.5, yet no r(s0, a) is 0.5
    model = dataclasses.replace(
        random_option_model(shape=(1, 1, 2), gamma=0.0),
        reward=np.array([[0.0, 1.0]]),
        action=np.array([[[0.5, 0.5]]]),
    )
    assert exact.evaluate(model).v_bar[0, 0] == 0.5


def test_missing_transition_mass_ends_the_episode():
    ending = random_hit_mdp()
    ending = dataclasses.replace(ending, transition=0.7 * ending.transition)
    # the same with a state to go to, where nothing is earned
    transition = np.zeros((S + 1, A, S + 1))
    transition[:S, :, :S] = ending.transition
    transition[:S, :, S], transition[S, :, S] = 0.3, 1.0
    absorbing = HiTMDP(
        transition=transition,
        reward=np.concatenate([ending.reward, np.zeros((1, A))]),
        master=np.concatenate([ending.master, ending.master[:1]]),
        action=np.concatenate([ending.action, ending.action[:, :1]], axis=1),
        gamma=ending.gamma,
    )
    np.testing.assert_allclose(
        exact.hidden_values(ending).v_bar, exact.hidden_values(absorbing).v_bar[:S], rtol=1e-12
    )


def test_evaluate_jits_vmaps_and_differentiates():
    models = [random_option_model(seed) for seed in range(3)]
    stacked = jax.tree.map(lambda *x: np.stack(x), *models)
    batch = jax.jit(jax.vmap(evaluate))(stacked)
    alone = jax.tree.map(lambda *x: np.stack(x), *map(exact.evaluate, models))
    for x, y in zip(jax.tree.leaves(batch), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-10)
    np.testing.assert_allclose(evaluate(models[2]).v, alone.v[2], rtol=1e-10)  # not jitted
    never = dataclasses.replace(models[0], termination=np.zeros((K, S)))
    gradient = jax.jit(jax.grad(lambda m: evaluate(m).v_bar.sum()))(never)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(gradient))


def joint_step(model, first):
    """P(s0, o0, a0, s1, b1, o1), axes in this order."""
    beta = np.stack([1 - model.termination, model.termination])  # [b, o0, s1]
    master = model.master
    choice = np.stack(  # [b, s1, o0, o1]
        [np.broadcast_to(np.eye(K), (S, K, K)), np.broadcast_to(master[:, None], (S, K, K))]
    )
    return np.einsum(
        "so,osa,sat,bot,btop->soatbp",
        first,
        model.action,
        model.transition,
        beta,
        choice,
    )


def conditional(joint, value, given_axes):
    """E[value | the variables on given_axes], broadcast against joint."""
    others = tuple(i for i in range(joint.ndim) if i not in given_axes)
    total = (joint * value).sum(others, keepdims=True)
    return total / joint.sum(others, keepdims=True)


@pytest.mark.parametrize(
    ("equation", "printed", "right", "claimed_irrelevant"),
    [
        # G_{t+1} _||_ b_{t+1} | o_{t+1}: the termination tells where the agent arrived
        ("29", (5,), (3, 5), 4),
        # G_{t+1} _||_ s_t | s_{t+1}, o_t: right as printed
        ("30", (3, 1), (3, 1), 0),
        # G_{t+1} _||_ a_t | s_{t+1}: the action tells which option is under way
        ("31", (3,), (3, 1), 2),
        # G_{t+1} _||_ o_t | s_{t+1}, o_{t+1}: right as printed
        ("32", (3, 5), (3, 5), 1),
    ],
)
def test_conditional_independences_29_to_32(equation, printed, right, claimed_irrelevant):
    model = random_option_model()
    joint = joint_step(model, np.full((S, K), 1 / (S * K)))
    next_return = exact.evaluate(model).q_option[None, None, None, :, None, :]  # E[G_1 | s1, o1]

    def dependence(conditions):
        without = conditional(joint, next_return, conditions)
        return sup_norm(
            conditional(joint, next_return, (*conditions, claimed_irrelevant)) - without
        )

    assert dependence(right) < 1e-12
    assert (dependence(printed) > 1e-3) == (printed != right)


def test_eq_33_needs_the_state_and_holds_for_one_step_only():
    # printed: {R_{t+1}, G_t, s_{t+1}} _||_ o_t | a_t
    model = random_option_model()
    q_action = exact.evaluate(
        model
    ).q_action  # E[G_t | s, o, a]: the option goes on after the action
    assert sup_norm(q_action - q_action.mean(1, keepdims=True)) > 1e-3
    # the option also tells of the state, hence of the reward; given s_t too, it tells nothing
    joint = np.einsum("so,osa->soa", np.full((S, K), 1 / (S * K)), model.action)
    reward = model.reward[:, None]
    by_option = conditional(joint, reward, (1, 2)) - conditional(joint, reward, (2,))
    assert sup_norm(by_option) > 1e-3
    given_state = conditional(joint, reward, (0, 1, 2)) - conditional(joint, reward, (0, 2))
    assert sup_norm(given_state) < 1e-12
