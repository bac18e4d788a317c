from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hitmdp_jax.learning.episodes import RECENT_EPISODES, EpisodeWindow
from tests.programs import compiled


@compiled
def add(window, finished, returns):
    outcome = SimpleNamespace(finished=finished, episode_return=returns, episode_length=returns + 5)
    window = window.add(outcome)
    return window, window.metrics()


@settings(deadline=None, max_examples=30)
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
