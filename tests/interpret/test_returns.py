"""A run's returns at its end, against plain loops over its reports."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hitmdp_jax.interpret.returns import (
    failed,
    final_returns,
    final_window,
    headline,
    last_episodes,
    length_warning,
    one_window,
)
from tests.interpret.reports import made_up

METRICS = {
    "env_steps": np.array([[100_000, 200_000, 250_000, 300_000]]),
    "episode_return": np.array([[-99.0, -99.0, 1.0, 5.0]]),
    "episodes": np.array([[1.0, 1.0, 3.0, 1.0]]),
}


@pytest.mark.parametrize(
    ("reports", "switch_at", "expected", "window"),
    [
        # after 200,000: (3 * 1 + 1 * 5) / 4
        (4, None, 2.0, "the last 100,000 steps"),
        (4, 250_000, 5.0, "all 50,000 steps of the second task"),
        (4, 100_000, 2.0, "the last 100,000 steps"),
        (4, 300_000, 2.0, "the last 100,000 steps"),  # the second task has not begun
        (1, None, -99.0, "all 100,000 steps"),
    ],
)
def test_final_returns_weigh_the_last_episodes_and_say_which(reports, switch_at, expected, window):
    metrics = {name: x[:, :reports] for name, x in METRICS.items()}
    np.testing.assert_allclose(final_returns(metrics, switch_at), [expected])
    assert final_window(int(metrics["env_steps"][0, -1]), switch_at) == window
    name, score = headline(metrics, switch_at)
    assert name == f"return of {window}"
    assert float(score) == expected


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(0, 300_000))
def test_the_last_episodes_are_those_a_loop_from_the_end_finds(seed, count, since):
    metrics = made_up(np.random.default_rng(seed))
    for i, found in enumerate(last_episodes(metrics, count, since)):
        total = episodes = 0.0
        for t in reversed(range(metrics["env_steps"].shape[1])):
            if episodes >= count or metrics["env_steps"][i, t] <= since:
                break
            if metrics["episodes"][i, t]:
                episodes += metrics["episodes"][i, t]
                total += metrics["episodes"][i, t] * metrics["episode_return"][i, t]
        expected = total / episodes if episodes >= count else np.nan
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_runs_of_unlike_length_are_compared_with_a_warning():
    assert length_warning({"mopg": 2_002_944, "oc": 2_003_280}) is None
    assert length_warning({"mopg": 100_000, "ppo": 20_480}) == (
        "The runs are of unlike length, and a longer one learned for longer: mopg 100,000, "
        "ppo 20,480 steps."
    )
    assert one_window(["all 20,480 steps"] * 2) == "all 20,480 steps"
    assert one_window(["all 20,480 steps", "the last 100,000 steps"]) == (
        "the last 100,000 steps, or all of a shorter run"
    )


@pytest.mark.parametrize(("returns", "expected"), [([-4.0, -5.0, -9.0], 1), ([4.0, 5.0, 1.0], 1)])
def test_a_seed_far_below_the_median_has_failed(returns, expected):
    assert failed(np.array(returns)) == expected
