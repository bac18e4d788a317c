import itertools
import warnings

import numpy as np
import pytest

from hitmdp_jax.interpret.statistics import (
    bootstrap_interval,
    difference,
    interquartile_mean,
    mean_improvement,
    number_text,
    probability_of_improvement,
    rounding,
    with_interval,
)

# Ten seeds of one algorithm and eight of another on three tasks. The values below that are said to
# be rliable's were computed with rliable 1.2.0, by 50,000 resamples.
X = np.array(
    [
        [0.13, 0.1, 1.3, -1.27, -2.33, -0.73, 0.41, 1.37, 0.9, -0.92],
        [-0.13, -0.54, 0.95, -0.62, -0.22, -0.54, 1.04, -0.67, 0.09, -0.46],
        [0.64, 0.36, -0.7, 0.04, -1.25, -0.32, -0.13, 0.35, -0.74, 0.22],
    ]
)
Y = np.array(
    [
        [-0.51, 1.04, -0.15, 1.99, 1.85, 0.19, 2.3, -0.71],
        [0.29, 0.71, 0.37, -0.76, 1.28, 1.96, 1.82, 0.5],
        [0.34, 0.86, 1.28, 2.01, 0.76, 2.46, 0.86, 1.16],
    ]
)


@pytest.fixture(autouse=True)
def no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def test_interquartile_mean_drops_the_outer_quarters():
    assert interquartile_mean([-1000.0, 1.0, 2.0, 1000.0]) == 1.5
    assert interquartile_mean([7.0, 1.0, 3.0, 2.0, 5.0]) == pytest.approx(10 / 3)  # 5 // 4 = 1 off


def test_interquartile_mean_pools_its_strata_as_rliable_does():
    assert interquartile_mean(*X) == pytest.approx(-0.14625)


def test_probability_of_improvement_counts_pairs_and_half_of_ties():
    # (1 > 0), (1 = 1), (2 > 0), (2 > 1): 3.5 of 4
    assert probability_of_improvement([1.0, 2.0], [0.0, 1.0]) == 0.875
    # rliable's; it averages over the tasks
    np.testing.assert_allclose(probability_of_improvement(X, Y), [0.3, 0.225, 0.0375])
    np.testing.assert_allclose(probability_of_improvement(X.T, Y.T, axis=0), [0.3, 0.225, 0.0375])


def test_interval_is_that_of_rliable():
    low, high = bootstrap_interval(interquartile_mean, *X)
    assert low == pytest.approx(-0.42625, abs=0.03)
    assert high == pytest.approx(0.180625, abs=0.03)


@pytest.mark.parametrize(
    ("scores", "iqm"),
    [((3632, 3728, 3040, 3416), 3524), ((2265, 2977, 2405, 1995), 2335)],  # as rliable gave them
)
def test_published_means_are_found_again(scores, iqm):
    assert interquartile_mean(scores) == pytest.approx(iqm)


def test_interval_is_that_of_every_possible_resample():
    scores = np.array([1.0, 2.2, 2.9, 4.1, 5.3, 6.0])
    resamples = np.array(list(itertools.product(scores, repeat=6)))  # 46,656
    exact = np.quantile(np.sort(resamples)[:, 1:5].mean(axis=1), [0.025, 0.975])
    assert bootstrap_interval(interquartile_mean, scores) == pytest.approx(tuple(exact), abs=0.15)


def test_interval_of_an_improvement_resamples_both_sides():
    low, high = bootstrap_interval(probability_of_improvement, X[0], Y[0])
    assert 0.0 <= low < 0.3 < high < 0.7
    better = [5.0, 6.0, 7.0, 8.0, 9.0], [0.0, 1.0, 2.0, 3.0, 4.0]
    assert bootstrap_interval(probability_of_improvement, *better) == (1.0, 1.0)


def test_the_improvement_on_many_tasks_counts_each_the_same():
    pairs = [scores for both in zip(X, Y, strict=True) for scores in both]
    assert mean_improvement(*pairs) == pytest.approx(0.1875)  # rliable's
    # A task of more seeds, all better, counts no more than one of fewer.
    assert mean_improvement([1.0], [2.0], [1.0] * 9, [0.0] * 9) == 0.5
    rng = np.random.default_rng(1)
    resampled = [
        np.mean(
            [
                (rng.choice(x, len(x))[:, None] > rng.choice(y, len(y))[None]).mean()
                for x, y in zip(X, Y, strict=True)
            ]
        )
        for _ in range(4000)
    ]
    expected = np.percentile(resampled, [2.5, 97.5])
    np.testing.assert_allclose(bootstrap_interval(mean_improvement, *pairs), expected, atol=0.015)


@pytest.mark.parametrize("seeds", [1, 2, 3, 4, 5])
def test_fewer_than_five_seeds_have_no_interval(seeds):
    scores, many = [3.0] * seeds, [1.0] * 9
    assert with_interval(interquartile_mean, scores) == ("3.0" if seeds < 5 else "3.0 [3.0, 3.0]")
    # of two arms the smaller one counts
    assert with_interval(difference, many, scores) == ("-2.0" if seeds < 5 else "-2.0 [-2.0, -2.0]")


def test_few_seeds_have_the_mean():
    assert interquartile_mean([3.0]) == 3.0
    assert interquartile_mean([3.0, 4.0, 8.0]) == 5.0


def test_an_unknown_score_is_not_trimmed_away():
    scores = [1.0, 2.0, 3.0, 4.0, np.nan]
    assert np.isnan(interquartile_mean(scores))
    assert np.isnan(probability_of_improvement(scores, [0.0, 1.0]))
    assert np.isnan(bootstrap_interval(interquartile_mean, scores)).all()


def test_an_unknown_number_is_a_dash():
    assert [number_text(x) for x in (1234.56, float("nan"), -0.04)] == ["1234.6", "-", "0.0"]


def test_a_table_shows_small_returns_by_a_digit_more():
    assert rounding([-4.27, np.nan], [-5.0]) == ".2f"
    assert rounding([-4.27], [5435.8]) == ".1f"
    assert rounding([-4.27], fewer=1) == ".1f"
    assert rounding([np.nan]) == ".2f"
