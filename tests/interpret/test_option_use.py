"""The masked array code against plain loops over single episodes."""

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hitmdp_jax.interpret.option_use import (
    activations,
    durations,
    effective_number,
    switch_rate,
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
def test_switches_and_transitions_count_pairs_within_episodes(episodes, padding):
    option, alive = pad(episodes, padding)
    counts = Counter(pairs(episodes))
    switches = sum(n for (i, j), n in counts.items() if i != j)
    rate = switches / counts.total() if counts else math.nan
    assert switch_rate(option, alive) == pytest.approx(rate, nan_ok=True)
    matrix = transition_matrix(option, alive, NUM_OPTIONS)
    for i in range(NUM_OPTIONS):
        total = sum(counts[i, j] for j in range(NUM_OPTIONS))
        expected = [counts[i, j] / total if total else math.nan for j in range(NUM_OPTIONS)]
        np.testing.assert_allclose(matrix[i], expected)


@given(st.lists(st.integers(0, 9), min_size=1, max_size=16).filter(any))
def test_effective_number_lies_between_one_and_the_options_in_use(counts):
    shares = np.array(counts) / sum(counts)
    expected = math.exp(-sum(p * math.log(p) for p in shares if p))
    found = effective_number(shares)
    assert found == pytest.approx(expected)
    assert 1 - 1e-9 <= found <= np.count_nonzero(counts) + 1e-9


def test_options_used_alike_all_count():
    np.testing.assert_allclose(
        effective_number([[0.25] * 4, [0.5, 0.5, 0, 0], [0, 0, 1, 0]]), [4, 2, 1]
    )
