import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from hitmdp_jax.learning.advantages import (
    discounted_returns,
    generalized_advantages,
    standardize,
)
from tests.programs import compiled

estimate = compiled(generalized_advantages, static_argnums=7)
discount = compiled(discounted_returns, static_argnums=5)


def advantages_by_loop(reward, value, next_value, terminated, truncated, gamma, lam, bootstrap):
    """The definition, one environment and one step at a time."""
    T, B = reward.shape
    result = np.zeros((T, B))
    for b in range(B):
        running = 0.0
        for t in reversed(range(T)):
            ended = terminated[t, b] or truncated[t, b]
            if ended:
                running = 0.0
            follows = 0.0 if terminated[t, b] or (truncated[t, b] and not bootstrap) else 1.0
            delta = reward[t, b] + gamma * follows * next_value[t, b] - value[t, b]
            running = delta + gamma * lam * running
            result[t, b] = running
    return result


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**31),
    shape=st.sampled_from([(1, 1), (2, 3), (12, 2)]),  # each is compiled anew
    gamma=st.floats(0, 1),
    lam=st.floats(0, 1),
    bootstrap=st.booleans(),
)
def test_advantages_equal_a_plain_loop(seed, shape, gamma, lam, bootstrap):
    rng = np.random.default_rng(seed)
    reward, value, next_value = rng.normal(size=(3, *shape))
    terminated = rng.random(shape) < 0.2
    truncated = (rng.random(shape) < 0.2) & ~terminated
    arguments = (reward, value, next_value, terminated, truncated, gamma, lam, bootstrap)
    np.testing.assert_allclose(
        estimate(*arguments), advantages_by_loop(*arguments), rtol=1e-4, atol=1e-5
    )


def one_step(terminated, truncated, bootstrap=True):
    column = np.ones((1, 1))
    # reward 1, value 2, next value 4, gamma 0.5: bootstrapped 1 + 0.5 * 4 - 2 = 1, else 1 - 2 = -1
    return estimate(
        column, 2 * column, 4 * column, column == terminated, column == truncated, 0.5, 1, bootstrap
    ).item()


def test_truncated_step_bootstraps_from_the_final_observation():
    assert one_step(terminated=0, truncated=1) == 1.0


def test_terminated_step_does_not_bootstrap():
    assert one_step(terminated=1, truncated=0) == -1.0


def test_truncation_can_be_treated_as_termination():
    assert one_step(terminated=0, truncated=1, bootstrap=False) == -1.0


def test_lambda_one_gives_discounted_returns_less_values():
    reward = np.array([[1.0], [2.0], [4.0]])
    zero = np.zeros_like(reward)
    ended = np.array([[False], [False], [True]])
    # 1 + 2/2 + 4/4 = 3, 2 + 4/2 = 4, 4
    result = estimate(reward, zero, zero, ended, zero > 0, 0.5, 1.0, True)
    np.testing.assert_allclose(result[:, 0], [3.0, 4.0, 4.0])


def returns_by_loop(reward, next_value, terminated, truncated, gamma, bootstrap):
    T, B = reward.shape
    result = np.zeros((T, B))
    for b in range(B):
        for t in reversed(range(T)):
            if terminated[t, b] or (truncated[t, b] and not bootstrap):
                after = 0.0
            elif truncated[t, b] or t == T - 1:
                after = next_value[t, b]
            else:
                after = result[t + 1, b]
            result[t, b] = reward[t, b] + gamma * after
    return result


@pytest.mark.parametrize("bootstrap", [True, False])
def test_returns_equal_a_plain_loop(bootstrap):
    rng = np.random.default_rng(0)
    reward, next_value = rng.normal(size=(2, 12, 5))
    terminated = rng.random((12, 5)) < 0.2
    truncated = (rng.random((12, 5)) < 0.2) & ~terminated
    arguments = (reward, next_value, terminated, truncated, 0.9, bootstrap)
    np.testing.assert_allclose(
        discount(*arguments), returns_by_loop(*arguments), rtol=1e-4, atol=1e-5
    )


def test_shapes_that_would_broadcast_are_rejected():
    column, row = np.ones((3, 1)), np.ones((1, 3))
    with pytest.raises(AssertionError):
        generalized_advantages(column, row, column, column > 1, column > 1, 0.9, 0.9)


def test_standardize_has_mean_zero_and_unit_deviation():
    x = compiled(standardize)(np.array([[1.0, 2.0], [3.0, 10.0]]))
    assert abs(x.mean()) < 1e-6
    assert abs(x.std() - 1) < 1e-6
