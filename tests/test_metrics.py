"""The vocabulary of metrics, and what becomes of them over iterations."""

import numpy as np
import pytest

from hitmdp_jax.metrics import (
    REWARD_TERM,
    VOCABULARY,
    describe,
    over_iterations,
)
from tests.programs import compiled

reduce_iterations = compiled(over_iterations)


def test_every_entry_is_told_apart():
    meanings = [metric.meaning for metric in VOCABULARY.values()]
    assert len(set(meanings)) == len(meanings)


def test_patterns_and_names():
    assert describe("option_kl") is describe("action_kl") is VOCABULARY["*_kl"]
    assert describe("reward_forward") is REWARD_TERM


@pytest.fixture
def stacked():
    return {
        "episodes": np.array([2.0, 0.0, 1.0]),
        "episode_return": np.array([10.0, np.nan, 40.0]),
        "option_steps": np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]),
        "unstable": np.array([0.0, 0.3, 0.0]),
        "recent_return": np.array([1.0, 2.0, 3.0]),
        "option_kl": np.array([0.1, 0.2, 0.6]),
        "reward_forward": np.array([1.0, 2.0, 6.0]),
    }


def test_iterations_are_reduced_by_kind(stacked):
    reduced = reduce_iterations(stacked)
    expected = {
        "episodes": 3.0,
        "episode_return": 20.0,  # (2 * 10 + 1 * 40) / 3
        "option_steps": [9.0, 12.0],
        "unstable": 0.1,
        "recent_return": 3.0,
        "option_kl": 0.3,
        "reward_forward": 3.0,
    }
    assert reduced.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_allclose(reduced[name], value, rtol=1e-6, err_msg=name)


def test_no_episodes_have_no_return(stacked):
    none = stacked | {"episodes": np.zeros(3)}
    assert np.isnan(reduce_iterations(none)["episode_return"])
