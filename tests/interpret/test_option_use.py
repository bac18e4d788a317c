"""The masked array code against plain loops over single episodes."""

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hitmdp_jax.agents import PPO, Agent
from hitmdp_jax.agents.base import static
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.option_use import (
    activations,
    durations,
    number_of_options,
    transition_matrix,
    usage,
)

NUM_OPTIONS = 3
episodes = st.lists(
    st.lists(st.integers(0, NUM_OPTIONS - 1), min_size=1, max_size=12), min_size=1, max_size=4
)
# Padding is whatever the policy went on to do after the end.
padding = st.lists(st.integers(0, NUM_OPTIONS - 1), min_size=12, max_size=12)


def pad(episodes, padding):
    longest = max(map(len, episodes))
    option = np.array([(e + padding)[:longest] for e in episodes]).T
    alive = np.arange(longest)[:, None] < [len(e) for e in episodes]
    return option, alive


def runs(episode):
    return [(k, len(list(group))) for k, group in itertools.groupby(episode)]


def pairs(episodes):
    return [pair for e in episodes for pair in itertools.pairwise(e)]


@given(episodes, padding)
def test_activations_are_the_runs_of_each_episode(episodes, padding):
    sequences = activations(*pad(episodes, padding))
    assert len(sequences) == len(episodes)
    for sequence, episode in zip(sequences, episodes, strict=True):
        assert list(zip(sequence.option, sequence.duration, strict=True)) == runs(episode)
        assert sequence.duration.sum() == len(episode)
        np.testing.assert_array_equal(np.array(episode)[sequence.start], sequence.option)


@given(episodes, padding)
def test_durations_are_the_mean_of_an_episodes_runs(episodes, padding):
    found = durations(*pad(episodes, padding), NUM_OPTIONS)
    assert found.shape == (len(episodes), NUM_OPTIONS)
    for row, episode in zip(found, episodes, strict=True):
        for k, duration in enumerate(row):
            lengths = [n for option, n in runs(episode) if option == k]
            expected = sum(lengths) / len(lengths) if lengths else math.nan
            assert duration == pytest.approx(expected, nan_ok=True)


@given(episodes, padding)
def test_usage_counts_every_step_of_every_episode(episodes, padding):
    counts = Counter(itertools.chain(*episodes))
    expected = [counts[k] / counts.total() for k in range(NUM_OPTIONS)]
    np.testing.assert_allclose(usage(*pad(episodes, padding), NUM_OPTIONS), expected)


@given(episodes, padding)
def test_transitions_count_pairs_within_episodes(episodes, padding):
    option, alive = pad(episodes, padding)
    counts = Counter(pairs(episodes))
    matrix = transition_matrix(option, alive, NUM_OPTIONS)
    for i in range(NUM_OPTIONS):
        total = sum(counts[i, j] for j in range(NUM_OPTIONS))
        expected = [counts[i, j] / total if total else math.nan for j in range(NUM_OPTIONS)]
        np.testing.assert_allclose(matrix[i], expected)


class CannotBeAsked(Agent):
    """Has options, and no policy to ask for under one of them."""

    num_options: int = static(2)
    init = act = update = None


@pytest.mark.parametrize("agent", [PPO(), CannotBeAsked()], ids=type)
def test_agents_without_options_say_so(agent):
    with pytest.raises(UsageError, match=f"{type(agent).__name__} has no options to look into"):
        number_of_options(agent)
