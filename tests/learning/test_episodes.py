from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hitmdp_jax.learning.episodes import RECENT_EPISODES, EpisodeWindow, episode_metrics
from tests.programs import compiled


@compiled
def add(window, finished, returns):
    outcome = SimpleNamespace(finished=finished, episode_return=returns, episode_length=returns + 5)
    window = window.add(outcome)
    return window, window.metrics()


@settings(max_examples=30)
@given(st.lists(st.integers(0, 130), min_size=1, max_size=5), st.integers(0, 2**31 - 1))
def test_recent_returns_are_means_over_the_last_episodes(counts, seed):
    """Against a deque: rollouts of 10 x 13 steps in which so many episodes end."""
    random = np.random.default_rng(seed)
    window, last = EpisodeWindow.empty(), deque(maxlen=RECENT_EPISODES)
    for count in counts:
        finished = random.permutation(np.arange(130) < count).reshape(10, 13)
        returns = random.normal(size=(10, 13)).astype(np.float32)
        window, metrics = add(window, finished, returns)
        last.extend(returns[finished])
    assert int(window.count) == sum(counts)
    if last:
        assert float(metrics["recent_return"]) == pytest.approx(np.mean(last), abs=1e-5)
        assert float(metrics["recent_length"]) == pytest.approx(np.mean(last) + 5, abs=1e-4)
    else:
        assert np.isnan(metrics["recent_return"])


def test_success_is_read_at_the_end_of_episodes_and_other_reports_at_every_step():
    # Two episodes of three steps side by side, in which alone the first one's goal is reached, and
    # the beginning of two more.
    outcome = SimpleNamespace(
        finished=np.array([[0, 0], [0, 0], [1, 1], [0, 0]], bool),
        episode_return=np.zeros((4, 2)),
        episode_length=np.tile([[1], [2], [3], [1]], 2),
        reward=np.arange(8.0).reshape(4, 2),
        metrics={
            "success": np.array([[0, 0], [1, 0], [1, 0], [1, 1]], np.float32),
            "speed": np.array([[1, 2], [3, 4], [5, 6], [7, 8]], np.float32),
        },
    )
    metrics = episode_metrics(outcome)
    assert metrics["success"] == 0.5
    assert metrics["speed"] == 4.5
    assert metrics["step_reward"] == 3.5
    outcome.finished = np.zeros((4, 2), bool)
    metrics = episode_metrics(outcome)
    assert np.isnan(metrics["success"])
    assert metrics["step_reward"] == 3.5
