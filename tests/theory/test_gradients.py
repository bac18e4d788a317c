import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given

from hitmdp_jax.theory import (
    HiTMDP,
    evaluate,
    hidden_values,
    hit_mdp,
    markovian_master_policy,
    master_policy_gradient,
    objective,
    occupancy,
    option_log_posterior,
)
from tests.programs import compiled
from tests.theory import exact

from .strategies import (
    SHAPE,
    distributions,
    few,
    hit_mdps,
    random_hit_mdp,
    random_option_model,
    with_start,
)

S, K, A = SHAPE
EXACT = {"rtol": 1e-8, "atol": 1e-8}


@compiled
def master_autodiff(hit, start):
    return jax.grad(lambda p: objective(dataclasses.replace(hit, master=p), start))(hit.master)


@compiled
def action_autodiff(hit, start):
    def q_option(policy):
        return (start * hidden_values(dataclasses.replace(hit, action=policy)).q_option).sum()

    return jax.grad(q_option)(hit.action)


@compiled
def softmax_autodiff(logits, hit, start):
    """The gradient of the objective in the logits of both policies."""
    return jax.grad(lambda x: objective(softmax(x, hit), start))(logits)


@compiled
def through_softmax(logits, gradient):
    _, pull_back = jax.vjp(lambda x: tuple(jax.nn.softmax(y) for y in x), logits)
    return pull_back(gradient)[0]


def softmax(logits, hit):
    master, action = (jax.nn.softmax(x) for x in logits)
    return dataclasses.replace(hit, master=master, action=action)


@few
@given(with_start(hit_mdps()))
def test_theorem_4_2_master_policy_gradient_is_autodiffs(drawn):
    formula = exact.master_policy_gradient(*drawn)
    np.testing.assert_allclose(formula, master_autodiff(*drawn), **EXACT)


@few
@given(with_start(hit_mdps()))
def test_theorem_4_3_action_policy_gradient_is_autodiffs(drawn):
    formula = exact.action_policy_gradient(*drawn)
    np.testing.assert_allclose(formula, action_autodiff(*drawn), **EXACT)


@few
@given(with_start(hit_mdps()))
def test_gradient_of_softmax_policies_is_autodiffs(drawn):
    hit, start = drawn
    logits = np.log(hit.master), np.log(hit.action)
    gradient = exact.policy_gradient(hit, start)
    formula = through_softmax(logits, (gradient.master, gradient.action))
    expected = softmax_autodiff(logits, hit, start)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, **EXACT), formula, expected)


def test_gradients_at_one_augmented_state_as_the_theorems_state_them():
    hit = random_hit_mdp(option_entropy=0.2, action_entropy=0.1)
    one = np.zeros((S, K))
    one[1, 2] = 1.0

    @compiled
    def at_one(hit):
        def v_bar(master):
            return hidden_values(dataclasses.replace(hit, master=master)).v_bar[1, 2]

        def q_option(action):
            return hidden_values(dataclasses.replace(hit, action=action)).q_option[1, 2]

        return jax.grad(v_bar)(hit.master), jax.grad(q_option)(hit.action)

    master, action = at_one(hit)
    np.testing.assert_allclose(exact.master_policy_gradient(hit, one), master, **EXACT)
    np.testing.assert_allclose(exact.action_policy_gradient(hit, one), action, **EXACT)


def test_theorem_4_2_through_eq_22_is_the_termination_gradient_theorem():
    # Bacon et al. 2017: dJ/dbeta_o(s) = -d(s, o) (Q_O[s, o] - V[s]), here at every arrival
    model, start = random_option_model(), np.full((S, K), 1 / (S * K))

    @compiled
    def both(model):
        hit, values = hit_mdp(model), evaluate(model)
        _, pull_back = jax.vjp(
            lambda beta: markovian_master_policy(dataclasses.replace(model, termination=beta)),
            model.termination,
        )
        (formula,) = pull_back(master_policy_gradient(hit, start))
        advantage = values.q_option - values.v[:, None]
        return formula, -(occupancy(hit, start) * advantage).T

    np.testing.assert_allclose(*both(model), **EXACT)


def test_discounted_visits_sum_to_the_horizon():
    hit, start = random_hit_mdp(), np.full((S, K), 1 / (S * K))
    assert float(exact.occupancy(hit, start).sum()) == pytest.approx(10.0)


@pytest.mark.parametrize("choice", ["option_log_posterior", "action_information"])
def test_pointwise_information_may_be_held_constant(choice):
    # I depends on the policies, but the mean of its derivative is that of a score, 0. So the
    # formulas, which hold I constant, are the whole gradient.
    start = np.full((S, K), 1 / (S * K))
    hit = random_hit_mdp(4)

    def with_information(x):
        model = softmax(x, hit)
        information = option_log_posterior(model)
        if choice == "action_information":  # log pi_A(a | s, o) - log sum_o pi_O pi_A
            information = information - jnp.log(model.master)[..., None]
        return dataclasses.replace(model, information=information)

    logits = np.log(hit.master), np.log(hit.action)

    @compiled
    def both(logits):
        through = jax.grad(lambda x: objective(with_information(x), start))(logits)
        return with_information(logits).information, through

    held, through = both(logits)
    constant = softmax_autodiff(logits, dataclasses.replace(hit, information=held), start)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, **EXACT), through, constant)
    plain = softmax_autodiff(logits, hit, start)
    assert np.abs(plain[0] - constant[0]).max() > 1e-3  # I does matter


def test_eq_14_as_printed_is_not_zero_where_the_policy_cannot_change():
    # dP/dtheta = 0 leaves I + H(pi_O) standing outside the product: here log 2 at every step
    hit = dataclasses.replace(
        random_hit_mdp(shape=(1, 2, 2)), master=np.full((1, 2, 2), 0.5), option_entropy=1.0
    )
    start = np.array([[1.0, 0.0]])
    visited = exact.occupancy(hit, start)
    no_change = np.zeros((1, 2, 2))
    q_option = exact.hidden_values(hit).q_option[:, None]
    printed = (visited * ((no_change * q_option).sum(-1) + np.log(2.0))).sum()
    right = (no_change * exact.master_policy_gradient(hit, start)).sum()
    assert float(printed) == pytest.approx(10 * np.log(2))
    assert right == 0.0


def test_eq_14_with_the_entropy_inside_the_product_still_misses_its_gradient():
    # dP (Q_O + I + H): H is the same for every option, and sum_o dP(o) H = 0. Where all options
    # are worth the same, the true gradient pulls towards the uniform policy, this one is 0.
    hit = HiTMDP(
        transition=np.ones((1, 1, 1)),
        reward=np.zeros((1, 1)),
        master=np.ones((1, 2, 2)),
        action=np.ones((2, 1, 1)),
        gamma=0.0,
        option_entropy=1.0,
    )
    start = np.array([[1.0, 0.0]])
    logits = np.broadcast_to([1.0, 0.0], (1, 2, 2)), np.zeros((2, 1, 1))

    @compiled
    def both(logits):
        model = softmax(logits, hit)
        _, pull_back = jax.vjp(jax.nn.softmax, logits[0])
        worth = hidden_values(model).q_option[:, None] + jnp.full((1, 2, 2), 0.3)  # any constant H
        (printed,) = pull_back(occupancy(model, start)[:, :, None] * worth)
        (right,) = pull_back(master_policy_gradient(model, start))
        return printed, right

    printed, right = both(logits)
    np.testing.assert_allclose(printed, 0.0, atol=1e-15)
    np.testing.assert_allclose(right, softmax_autodiff(logits, hit, start)[0], **EXACT)
    assert right[0, 0, 0] < -0.1


@compiled
def expected_advantage(hit, delta, gae_lambda):
    """The mean GAE(lambda) of delta [S, K_prev, K], [S, K_prev, K]."""
    moves = jnp.einsum("osa,sat->sot", hit.action, hit.transition)

    def backward(_, advantage):
        later = jnp.einsum("sot,tox,tox->so", moves, hit.master, advantage)
        return delta + hit.gamma * gae_lambda * later[:, None]

    return jax.lax.fori_loop(0, 300, backward, delta)


def test_algorithm_1_as_printed_prefers_the_worse_option():
    # From state 0, option 0 earns 1 and ends in state 4, where nothing happens; option 1 walks
    # 0 -> 1 -> 2 -> 3 and earns 1.3, worth 1.3 * 0.9^3 = 0.948 now. Line 20 of Alg. 1 discounts
    # V[s] along with V[s'], gamma (V' - V) for gamma V' - V, and so pays for passing good states.
    transition, reward = np.zeros((5, 2, 5)), np.zeros((5, 2))
    transition[0, 0, 4] = transition[0, 1, 1] = 1.0
    for s, following in ((1, 2), (2, 3), (3, 4), (4, 4)):
        transition[s, :, following] = 1.0
    reward[0, 0], reward[3] = 1.0, 1.3
    hit = HiTMDP(
        transition=transition,
        reward=reward,
        master=np.full((5, 2, 2), 0.5),
        action=np.broadcast_to(np.eye(2)[:, None], (2, 5, 2)),
        gamma=0.9,
    )
    values = exact.hidden_values(hit)
    q_option, v_bar = values.q_option[:, None], values.v_bar[:, :, None]
    right = expected_advantage(hit, q_option - v_bar, 1.0)
    printed = expected_advantage(hit, q_option - hit.gamma * v_bar, 1.0)
    np.testing.assert_allclose(right, q_option - v_bar + np.zeros((5, 2, 2)), atol=1e-12)
    assert float(values.q_option[0, 0]) == pytest.approx(1.0)
    assert float(values.q_option[0, 1]) == pytest.approx(1.3 * 0.9**3)
    assert right[0, 0, 0] > right[0, 0, 1]
    assert printed[0, 0, 0] < printed[0, 0, 1] - 0.1


@few
@given(with_start(hit_mdps(interior=False, soft=False)), distributions(S, K, K))
def test_a_small_step_towards_another_policy_gains_what_the_gradient_says(drawn, other):
    # no autodiff here: the derivative along a line, by central differences
    hit, start = drawn
    direction, step = other - hit.master, 1e-5

    def along(t):
        return exact.objective(dataclasses.replace(hit, master=hit.master + t * direction), start)

    slope = (along(step) - along(-step)) / (2 * step)
    formula = (exact.master_policy_gradient(hit, start) * direction).sum()
    np.testing.assert_allclose(slope, formula, rtol=1e-3, atol=1e-4)


def test_the_two_streams_of_algorithm_1_drop_terms_of_the_action_gradient():
    # Actions decide which states, hence which option entropies and which I, come later. Alg. 1
    # rewards the action policy with H(pi_A) alone; the ELBO's gradient has the others too.
    hit, start = random_hit_mdp(5), np.full((S, K), 1 / (S * K))
    rewarded = dataclasses.replace(hit, option_entropy=1.0)
    dropped = (
        exact.policy_gradient(rewarded, start).action - exact.policy_gradient(hit, start).action
    )
    dropped -= dropped.mean(-1, keepdims=True)  # what is the same for every action moves nothing
    assert np.abs(dropped).max() > 1e-2
