"""Running statistics of observations, and what rounding makes of those that never change."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.acme.running_statistics import NestedMeanStd

from hitmdp_jax.learning.normalization import (
    OBSERVATION_CLIP,
    initial_statistics,
    normalize,
    update_statistics,
)

update = jax.jit(update_statistics)


def test_statistics_equal_those_of_all_observations(key):
    obs = jnp.array([3.0, -1.0]) + jnp.array([0.5, 20.0]) * jax.random.normal(key, (6, 50, 4, 2))
    statistics = initial_statistics(2)
    for part in obs:
        statistics = update(statistics, part)
    everything = np.asarray(obs, np.float64).reshape(-1, 2)
    np.testing.assert_allclose(statistics.mean, everything.mean(0), rtol=1e-4)
    np.testing.assert_allclose(statistics.std, everything.std(0), rtol=1e-4)


def test_nothing_is_normalised_before_anything_was_seen():
    obs = jnp.array([0.5, -3.0])
    np.testing.assert_array_equal(normalize(obs, initial_statistics(2)), obs)


@pytest.mark.parametrize("constant", [0.1, 0.3, 1.7, 3.3, 1000.0, 1000.1, -7.7])
@pytest.mark.parametrize("batch", [20, 2000, 2048])
def test_an_observation_that_never_changes_is_nearly_zero(constant, batch):
    statistics = initial_statistics(1)
    obs = jnp.full((batch, 1), constant)
    for _ in range(100):
        statistics = update(statistics, obs)
        assert jnp.abs(normalize(obs[0], statistics)) < 0.05


@pytest.mark.parametrize("constant", [10.1, 33.3, 64.7, 100.1])
def test_its_rounding_grows_with_its_size(constant):
    """The mean of a constant c is off by some 4e-7 |c|; 1e-4 of deviation makes that 0.004 |c|."""
    statistics, obs = initial_statistics(1), jnp.full((2048, 1), constant)
    for _ in range(100):
        statistics = update(statistics, obs)
        assert jnp.abs(normalize(obs[0], statistics)) < 0.005 * constant


def test_a_small_signal_is_not_hurt(key):
    obs = 0.3 + 1e-3 * jax.random.normal(key, (20, 2048, 1))
    statistics = initial_statistics(1)
    for part in obs:
        statistics = update(statistics, part)
    np.testing.assert_allclose(normalize(obs, statistics).std(), 1.0, rtol=0.01)


def test_outliers_are_clipped():
    statistics = NestedMeanStd(mean=jnp.zeros(2), std=jnp.array([1.0, 2.0]))
    obs = normalize(jnp.array([1e3, -4.0]), statistics)
    np.testing.assert_allclose(obs, [OBSERVATION_CLIP, -2.0])
