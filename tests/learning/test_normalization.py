"""Running statistics of observations, and what rounding makes of those that never change."""

import numpy as np
import pytest
from brax.training.acme.running_statistics import NestedMeanStd

from hitmdp_jax.learning.normalization import (
    OBSERVATION_CLIP,
    initial_statistics,
    normalize,
    update_statistics,
)
from tests.programs import compiled

update = compiled(update_statistics)
normal = compiled(normalize)
start = compiled(initial_statistics, static_argnums=0)


def test_statistics_equal_those_of_all_observations():
    obs = np.random.default_rng(0).normal([3.0, -1.0], [0.5, 20.0], (6, 50, 4, 2))
    statistics = start(2)
    for part in obs:
        statistics = update(statistics, part)
    everything = obs.reshape(-1, 2)
    np.testing.assert_allclose(statistics.mean, everything.mean(0), rtol=1e-4)
    np.testing.assert_allclose(statistics.std, everything.std(0), rtol=1e-4)


def test_nothing_is_normalised_before_anything_was_seen():
    obs = np.array([0.5, -3.0])
    np.testing.assert_array_equal(normal(obs, start(2)), obs)


@pytest.mark.parametrize("constant", [0.1, 0.3, 1.7, 3.3, 1000.0, 1000.1, -7.7])
@pytest.mark.parametrize("batch", [20, 2000, 2048])
def test_an_observation_that_never_changes_is_nearly_zero(constant, batch):
    statistics = start(1)
    obs = np.full((batch, 1), constant)
    for _ in range(100):
        statistics = update(statistics, obs)
        assert np.abs(normal(obs[0], statistics)) < 0.05


@pytest.mark.parametrize("constant", [10.1, 33.3, 64.7, 100.1])
def test_its_rounding_grows_with_its_size(constant):
    """The mean of a constant c is off by some 4e-7 |c|; 1e-4 of deviation makes that 0.004 |c|."""
    statistics, obs = start(1), np.full((2048, 1), constant)
    for _ in range(100):
        statistics = update(statistics, obs)
        assert np.abs(normal(obs[0], statistics)) < 0.005 * constant


def test_a_small_signal_is_not_hurt():
    obs = np.random.default_rng(0).normal(0.3, 1e-3, (20, 2048, 1))
    statistics = start(1)
    for part in obs:
        statistics = update(statistics, part)
    np.testing.assert_allclose(normal(obs, statistics).std(), 1.0, rtol=0.01)


def test_outliers_are_clipped():
    statistics = NestedMeanStd(mean=np.zeros(2), std=np.array([1.0, 2.0]))
    obs = normal(np.array([1e3, -4.0]), statistics)
    np.testing.assert_allclose(obs, [OBSERVATION_CLIP, -2.0])


@pytest.mark.parametrize("dtype", ["bool", "int8", "uint8", "int32", "uint32", "float16"])
def test_numbers_of_every_type_are_normalised_alike(dtype):
    obs = np.random.default_rng(0).integers(0, 5, (6, 50, 2)).astype(dtype)
    statistics, floats = start(2), obs.astype(np.float32)
    for part in obs:
        statistics = update(statistics, part)
    np.testing.assert_allclose(statistics.mean, floats.mean((0, 1)), rtol=1e-5)
    np.testing.assert_allclose(statistics.std, floats.std((0, 1)), rtol=1e-4)
    np.testing.assert_array_equal(normal(obs, statistics), normal(floats, statistics))
    assert np.abs(normal(obs, statistics).mean((0, 1))).max() < 1e-3
