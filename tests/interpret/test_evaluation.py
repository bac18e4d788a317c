import functools
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.agents import MOPG
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret import evaluation
from hitmdp_jax.interpret.episodes import run_episodes
from hitmdp_jax.interpret.evaluation import Scores, score, score_each, score_in_jax
from tests.probes import Counter, spec_of_sizes, untrained_policy

PENDULUM = {"name": "invertedpendulum"}


@functools.partial(jax.jit, static_argnums=(0, 1))
def untrained(observation_size, action_size, key):
    spec = spec_of_sizes(observation_size, action_size)
    return untrained_policy(MOPG(hidden_sizes=(8,), spec=spec), key)


def test_each_environment_scores_its_first_whole_episode(key):
    scores = score_in_jax(untrained(2, 1, key), Counter(), 3, key)
    np.testing.assert_array_equal(scores.returns, [5.0, 5.0, 5.0])
    np.testing.assert_array_equal(scores.lengths, [5, 5, 5])


class Arrives(Counter):
    """Reaches its goal at the fifth step, where the observed serial number is below a half."""

    def reset(self, rng):
        state: Any = super().reset(rng)
        return state.replace(metrics={"success": jnp.zeros(())})

    def step(self, state, action):
        state = super().step(state, action)
        reached = (state.obs[0] >= 5) & (state.obs[1] < 0.5)
        return state.replace(metrics={"success": reached.astype(float)})


def test_an_episode_succeeds_where_its_task_says_so_by_its_end(key):
    policy = untrained(2, 1, key)
    scores = score_in_jax(policy, Arrives(), 32, key)
    recorded = run_episodes(policy, Arrives(), key, 32)
    np.testing.assert_array_equal(scores.success, recorded.obs[0, :, 1] < 0.5)
    assert scores.success is not None
    assert 0 < scores.success.mean() < 1
    assert score_in_jax(policy, Counter(), 3, key).success is None


class CountsTraces(Counter):
    """How often a program that steps it was traced, and so compiled."""

    traces = 0

    def step(self, state, action):
        CountsTraces.traces += 1
        return super().step(state, action)


def test_all_seeds_of_a_run_share_one_compilation(key, monkeypatch):
    monkeypatch.setattr(evaluation, "make_env", lambda **_: CountsTraces())
    traces = []
    for seed_key in jax.random.split(key, 2):
        score(untrained(2, 1, seed_key), {"name": "halfcheetah"}, "warp", 3, seed_key)
        traces.append(CountsTraces.traces)
    assert traces[0] == traces[1] > 0


def test_a_single_episode_has_no_standard_error():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(Scores(np.array([3.0]), np.array([5])).standard_error)
    # deviations -1 and 1: std sqrt(2), over sqrt(2)
    assert Scores(np.array([1.0, 3.0]), np.array([5, 5])).standard_error == pytest.approx(1.0)


def test_engines_and_gymnasium_agree(key):
    """An untrained policy drops the pole after a few steps, in every engine alike."""
    policy = untrained(4, 1, key)
    scores = {e: score(policy, PENDULUM, e, 64, key) for e in ("native", "gymnasium")}
    native, gymnasium = scores["native"], scores["gymnasium"]
    difference = abs(native.returns.mean() - gymnasium.returns.mean())
    assert difference < 3 * np.hypot(native.standard_error, gymnasium.standard_error)
    for s in scores.values():
        # v5 gives 1 for every step but the one that ends the episode.
        np.testing.assert_array_equal(s.returns, s.lengths - 1)


@pytest.mark.parametrize("engine", ["native", "gymnasium"])
def test_policies_side_by_side_score_as_each_alone(key, engine):
    keys = list(jax.random.split(key, 3))
    alone = [untrained(4, 1, k) for k in keys]
    # What is swept has a training's axis; what is not has none.
    everyone = jax.tree.map(lambda *x: jnp.stack(x) if np.ndim(x[0]) else x[0], *alone)
    together = score_each(everyone.of(np.array([2, 0])), PENDULUM, engine, 4, [keys[2], keys[0]])
    for scores, i in zip(together, (2, 0), strict=True):
        expected = score(alone[i], PENDULUM, engine, 4, keys[i])
        np.testing.assert_array_equal(scores.lengths, expected.lengths)
        np.testing.assert_allclose(scores.returns, expected.returns, rtol=1e-5)


def test_mistakes_are_explained(key):
    with pytest.raises(UsageError, match="did you mean 'gymnasium'"):
        score(untrained(17, 6, key), PENDULUM, "gymnasum", 1, key)
    with pytest.raises(UsageError, match="episodes = 0 must be a positive whole number"):
        score(untrained(17, 6, key), PENDULUM, "native", 0, key)
