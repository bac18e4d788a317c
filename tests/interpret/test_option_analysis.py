"""Every answer about policies of each kind."""

import numpy as np
import pytest

from hitmdp_jax.agents import PPO
from hitmdp_jax.errors import UsageError
from tests.interpret.analyses import (
    analysis_of,
    analysis_of_embeddings,
    analysis_of_terminations,
)
from tests.interpret.known_returns import Payment

STATES = 3 * Payment.episode_length


def test_every_answer_is_an_array_of_its_shape():
    found, k = analysis_of_embeddings(), 9
    assert found.usage.sum() == pytest.approx(1.0)
    assert found.usage[found.by_usage[0]] == found.usage.max()
    assert found.durations.shape == (3, k)
    assert found.transitions.shape == found.divergence.shape == (k, k)
    assert found.interventions.returns.shape == (5 + k, 3)
    assert found.interventions is found.interventions  # computed once
    assert found.embeddings.shape == (k, 5)
    assert found.perturbation.actions.shape == (k, 5, 21, 1)
    assert found.attention.shape == (STATES, k)
    np.testing.assert_allclose(found.attention.sum(axis=1), 1.0, rtol=1e-5)
    assert found.projection.points.shape == (STATES, 2)
    assert found.terminations is None
    assert found.spec.action.names == ("action[0]",)


def test_choices_are_what_the_transitions_were_drawn_with():
    """The mean of P(o_t | s_t, o_{t-1}) over the steps after each option, by a plain loop."""
    found, k = analysis_of_embeddings(), 9
    recorded, after = found.trajectories, {i: [] for i in range(k)}
    for n in range(3):
        for t in range(1, Payment.episode_length):
            after[int(recorded.option[t - 1, n])].append(recorded.option_probs[t, n])
    expected = [np.mean(after[i], axis=0) if after[i] else np.full(k, np.nan) for i in range(k)]
    np.testing.assert_allclose(found.choices, expected, rtol=1e-5)
    np.testing.assert_array_equal(np.isnan(found.choices), np.isnan(found.transitions))


def test_options_without_embeddings_have_the_rest():
    found = analysis_of_terminations()
    assert found.embeddings is found.perturbation is found.attention is None
    assert found.terminations.shape == (STATES, 3)
    assert found.interventions.returns.shape == (8, 3)


def test_a_policy_without_options_is_refused():
    with pytest.raises(UsageError, match=r"PPO has no options to look into\."):
        analysis_of(PPO(hidden_sizes=(8,)))
