import jax
import numpy as np
import pytest

from hitmdp_jax.figures.catalogue import contraction as contraction_figure
from hitmdp_jax.figures.catalogue import variance as variance_figure
from hitmdp_jax.figures.theorems import (
    GAMMAS,
    NUM_ITERATIONS,
    TERMINATIONS,
    contraction,
    sample_models,
    variances,
)

ROUNDING = 1e-13


@pytest.fixture(scope="module")
def models():
    with jax.enable_x64(True):
        yield sample_models(jax.random.key(1))


@pytest.fixture(scope="module")
def distances(models):
    return contraction(models)


@pytest.fixture(scope="module")
def parts(models):
    return variances(models)


@pytest.fixture(scope="module")
def at_start(models):
    return variances(models, (0.1,), at_start=True)


def test_theorem_3_3_distances_stay_below_gamma_to_the_n(distances):
    bound = np.array(GAMMAS)[:, None, None] ** np.arange(NUM_ITERATIONS + 1)
    assert distances.dtype == np.float64
    np.testing.assert_allclose(distances[..., 0], 1.0, rtol=1e-15)
    assert np.all(distances <= bound + ROUNDING)


def test_distances_end_up_falling_at_the_rate_gamma(distances):
    rate = (distances[-2:, :, 200] / distances[-2:, :, 150]) ** (1 / 50)
    np.testing.assert_allclose(rate, np.array(GAMMAS[-2:])[:, None] * np.ones_like(rate), rtol=1e-4)


def test_proposition_3_5_is_strict_only_below_termination_one(parts):
    np.testing.assert_allclose(parts.total, parts.within + parts.between, rtol=1e-12)
    assert np.all(parts.within[:-1] < parts.total[:-1])
    assert TERMINATIONS[-1] == 1.0
    np.testing.assert_allclose(parts.within[-1], parts.total[-1], rtol=1e-12)


def test_proposition_3_5_is_an_equality_where_one_previous_option_occurs(at_start):
    np.testing.assert_allclose(at_start.within, at_start.total, rtol=1e-12)
    assert np.all(at_start.between == 0.0)


def test_contraction_figure_shows_each_median_below_its_bound(distances):
    (axes,) = contraction_figure.plot(distances).axes
    for i, gamma in enumerate(GAMMAS):
        median, bound = (line.get_ydata() for line in axes.lines[2 * i : 2 * i + 2])
        np.testing.assert_allclose(bound, gamma ** np.arange(NUM_ITERATIONS + 1))
        assert np.all(median <= bound + ROUNDING)


def test_variance_figure_shows_no_state_above_the_diagonal(parts, at_start):
    points, ratios = variance_figure.plot(parts, at_start).axes
    states = np.concatenate([dots.get_offsets() for dots in points.collections])
    assert len(states) == 4 * parts.total[0].size
    assert np.all(states[:, 1] <= states[:, 0] * (1 + ROUNDING))
    assert np.all(np.asarray(states) < points.get_xlim()[1])
    median = ratios.lines[0].get_ydata()
    assert median[-1] == pytest.approx(1.0)
    assert np.all(np.diff(median) > 0)
