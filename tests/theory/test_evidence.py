import dataclasses

import numpy as np
import pytest
from hypothesis import given
from scipy.special import logsumexp

from hitmdp_jax.theory import HiTMDP
from tests.theory import exact

from .strategies import TINY, distributions, few, hit_mdps, random_hit_mdp, with_start

T = 2

S, K, A = TINY


def one_state(reward, master, action, information=0.0):
    """A HiT-MDP of one state; master [K], whatever the previous option."""
    num_options = len(master)
    return HiTMDP(
        transition=np.ones((1, len(reward), 1)),
        reward=np.array([reward]),
        master=np.broadcast_to(np.array(master), (1, num_options, num_options)),
        action=np.array(action)[:, None],
        gamma=1.0,
        information=information,
    )


@few
@given(with_start(hit_mdps(TINY, interior=False), interior=True))
def test_theorem_4_1_log_evidence_is_elbo_plus_kl(drawn):
    result = exact.evidence(*drawn, T)
    np.testing.assert_allclose(result.log_evidence, result.elbo + result.kl, rtol=1e-12, atol=1e-12)
    assert result.kl >= -1e-12
    assert result.log_evidence <= 1e-12


@few
@given(with_start(hit_mdps(TINY, interior=False), interior=True))
def test_theorem_4_1_elbo_is_the_soft_return_up_to_a_constant(drawn):
    hit, start = drawn
    constant = T * (np.log(K * A) + hit.reward.max() + hit.information.max())
    np.testing.assert_allclose(
        exact.elbo_objective(hit, start, T) - constant,
        exact.evidence(hit, start, T).elbo,
        rtol=0,
        atol=1e-11,
    )


def test_theorem_4_1_with_three_steps():
    hit = random_hit_mdp(shape=TINY)
    start = np.array([[0.1, 0.2], [0.3, 0.4]])
    result = exact.evidence(hit, start, 3)
    assert float(result.log_evidence) == pytest.approx(float(result.elbo + result.kl))
    constant = 3 * (np.log(K * A) + float(hit.reward.max()))
    assert float(exact.elbo_objective(hit, start, 3)) - constant == pytest.approx(
        float(result.elbo)
    )


def test_eq_43_as_printed_drops_the_log_evidence():
    # printed: log q(e) >= -KL[P || q(.|e)]. With P the posterior the right side is 0, but an
    # action that pays -1 can be non-optimal, so q(e) < 1. (True: log q(e) = ELBO + KL.)
    optimal = np.exp([0.0, -1.0]) / np.exp([0.0, -1.0]).sum()
    hit = one_state([0.0, -1.0], [1.0], [optimal])
    result = exact.evidence(hit, np.ones((1, 1)), T)
    assert float(result.kl) == pytest.approx(0.0, abs=1e-12)
    assert float(result.log_evidence) == pytest.approx(T * np.log((1 + np.exp(-1)) / 2))
    assert result.log_evidence < -result.kl


def test_eq_10_as_printed_cannot_tell_good_states_from_bad():
    # The first action leads to state 1, which pays 1 whatever is done there, the second to
    # state 2, which pays 0. Eq. 10 divides by the sum of exp(r) over actions: the likelihood of
    # being optimal is 1/2 in both, and choosing the way to state 1 is worth nothing.
    transition = np.zeros((3, 2, 3))
    transition[0, 0, 1] = transition[0, 1, 2] = transition[1:, :, 0] = 1.0
    reward = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 0.0]])
    start = np.array([[1.0], [0.0], [0.0]])

    def objective(to_state_1, reward):
        action = np.array([[[to_state_1, 1 - to_state_1], [0.5, 0.5], [0.5, 0.5]]])
        hit = HiTMDP(transition, reward, np.ones((3, 1, 1)), action, 1.0)
        return float(exact.elbo_objective(hit, start, 2))

    printed = reward - logsumexp(reward, axis=1, keepdims=True)
    assert objective(0.8, printed) == pytest.approx(objective(0.2, printed))
    assert objective(0.8, reward) - objective(0.2, reward) == pytest.approx(0.6)


@few
@given(distributions(2, 2, interior=True))
def test_random_dynamics_keep_the_bound_from_being_tight(policy):
    # Luck decides the second state, which alone pays. The posterior q(tau | e) is lucky, no policy
    # is: the gap is at least log E[e^r] - E[r] = log((1 + e) / 2) - 1/2.
    hit = HiTMDP(
        transition=np.full((2, 2, 2), 0.5),
        reward=np.array([[0.0, 0.0], [1.0, 1.0]]),
        master=np.ones((2, 1, 1)),
        action=policy[None],
        gamma=1.0,
    )
    gap = exact.evidence(hit, np.array([[1.0], [0.0]]), 2).kl
    assert gap >= np.log((1 + np.e) / 2) - 0.5 - 1e-12


@few
@given(with_start(hit_mdps(TINY, soft=False), interior=True), distributions(S, K, K, interior=True))
def test_evidence_ignores_the_policies_if_i_is_the_option_posterior(drawn, other_master):
    hit, start = drawn
    other = dataclasses.replace(hit, master=other_master)
    levels = []
    for model in (hit, other):
        information = exact.option_log_posterior(model)
        np.testing.assert_allclose(np.exp(information).sum(2), 1.0, atol=1e-12)
        result = exact.evidence(dataclasses.replace(model, information=information), start, T)
        levels.append(float(result.log_evidence) + T * float(information.max()))
    assert levels[0] == pytest.approx(levels[1], abs=1e-11)


def test_elbo_and_kl_disagree_if_i_depends_on_the_policies_otherwise():
    # I = log pi_A(a | s, o) - log sum_o pi_O pi_A, what the option says of the action. It changes
    # the evidence along with the policy, so a higher ELBO may come with a larger divergence.
    def scores(action):
        master, action = np.array([0.1, 0.9]), np.array(action)
        information = np.log(action) - np.log(master @ action)
        hit = one_state([0.0, 0.0], master, action, information[None, None])
        start = np.full((1, 2), 0.5)
        return float(exact.elbo_objective(hit, start, 1)), float(exact.evidence(hit, start, 1).kl)

    elbo, kl = scores([[0.1, 0.9], [0.9, 0.1]])
    other_elbo, other_kl = scores([[0.1, 0.9], [0.1, 0.9]])
    assert elbo > other_elbo + 0.1
    assert kl > other_kl + 0.1


def test_eq_44_may_not_drop_the_option_entropy():
    # State 0 leads to state 1, where the master policy is undecided, or to state 2, where it is
    # not. H(pi_O) does not contain the action policy, but which state earns it does depend on it:
    # the best action policy prefers state 1 by 2 : 1, Eq. 44 is indifferent.
    transition = np.zeros((3, 2, 3))
    transition[0, 0, 1] = transition[0, 1, 2] = transition[1:, :, 0] = 1.0
    master = np.array([[1.0, 0.0], [0.5, 0.5], [1.0, 0.0]])
    start = np.array([[0.5, 0.5], [0.0, 0.0], [0.0, 0.0]])

    def objectives(to_state_1):
        each_state = np.array([[to_state_1, 1 - to_state_1], [0.5, 0.5], [0.5, 0.5]])
        action = np.broadcast_to(each_state, (2, 3, 2))
        hit = HiTMDP(
            transition,
            np.zeros((3, 2)),
            np.broadcast_to(master[:, None], (3, 2, 2)),
            action,
            1.0,
        )
        full = exact.elbo_objective(hit, start, 2)
        option_entropy = to_state_1 * exact.entropy(master)[1]
        return float(full), float(full - option_entropy)

    (best, dropped), (even, dropped_even) = objectives(2 / 3), objectives(1 / 2)
    assert best > even + 0.05
    assert dropped < dropped_even - 0.05
