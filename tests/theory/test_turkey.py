import jax
import numpy as np
import pytest

from hitmdp_jax.theory import turkey
from hitmdp_jax.theory.turkey import ROAST, STUFF
from tests.programs import compiled

tabulate = compiled(turkey.solve_with_state, static_argnums=0)
remember = compiled(turkey.solve_with_previous_action, static_argnums=0)
learn = compiled(turkey.solve_with_options, static_argnames=("num_options", "uniform_start"))


def test_values_of_the_image_find_both_actions_worth_the_same():
    solution = tabulate(5)
    np.testing.assert_allclose(solution.q, [[0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(solution.policy, [[0.5, 0.5]], atol=1e-9)
    assert float(solution.episode_return) == pytest.approx(0.0, abs=1e-9)


def test_values_with_the_previous_action_stuff_then_roast():
    solution = remember(5)
    # after roasting (a plain turkey): 0.9 * 10 or -10; after stuffing: 0.9 * 10 or 10
    np.testing.assert_allclose(solution.q[ROAST], [9.0, -10.0], atol=1e-9)
    np.testing.assert_allclose(solution.q[STUFF], [9.0, 10.0], atol=1e-9)
    assert solution.policy.argmax(-1).tolist() == [ROAST, STUFF]
    assert float(solution.episode_return) == pytest.approx(10.0)


@pytest.mark.parametrize("seed", range(3))
def test_hit_mdp_learns_to_stuff_then_roast(seed):
    solution = learn(jax.random.key(seed))
    start = solution.master.shape[0] - 1
    first = int(solution.master[start].argmax())
    second = int(solution.master[first].argmax())
    assert solution.action[first].argmax() == STUFF
    assert solution.action[second].argmax() == ROAST
    assert float(solution.episode_return) == pytest.approx(10.0, abs=0.01)
    assert float(solution.v_bar[start]) == pytest.approx(9.0, abs=0.01)
    assert float(solution.v_bar[first]) == pytest.approx(10.0, abs=0.01)


def test_a_uniform_first_memory_costs_return():
    # the option that means "stuffed" then begins a quarter of the episodes, with a plain turkey
    solution = learn(jax.random.key(0), uniform_start=True)
    assert 7.5 < float(solution.episode_return) < 8.5


def test_without_memory_rare_roasting_is_the_best_to_be_learnt():
    # One option is no memory. With P(roast) = p the return is 10 (1 - 2 p), discounted
    # J(p) = -10 p + 10 (1 - p) 0.9 p / (1 - 0.9 (1 - p)): better than V[s]'s 0, far from 10.
    solution = learn(jax.random.key(0), num_options=1, learning_rate=0.05)
    p = np.linspace(0.001, 0.999, 999)
    best = p[np.argmax(-10 * p + 10 * (1 - p) * 0.9 * p / (1 - 0.9 * (1 - p)))]
    assert float(solution.action[0, ROAST]) == pytest.approx(best, abs=2e-3)
    assert float(solution.episode_return) == pytest.approx(10 * (1 - 2 * best), abs=0.05)


def test_stuffing_is_worth_more_than_bootstrapping_finds():
    # Appendix A: Q[raw, stuff] = 0. By its definition, E[G | s, a], it is positive: a stuffed
    # turkey stays stuffed, and the uniform policy roasts it sooner or later, after n stuffings with
    # probability 2^-n: sum_n (0.9 / 2)^n 10 = 10 * 0.45 / 0.55.
    transition, reward = turkey.dynamics()
    value = np.linalg.solve(np.eye(2) - 0.9 * transition.mean(1), reward.mean(1))
    assert 0.9 * value[turkey.STUFFED] == pytest.approx(10 * 0.45 / 0.55)
