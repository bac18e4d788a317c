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
from hitmdp_jax.interpret.evaluation import Scores, score_each
from tests.probes import Counter, spec_of_sizes, untrained_policy

PENDULUM = {"name": "invertedpendulum"}
KEYS = jax.random.split(jax.random.key(0), 3)


def untrained(observation_size, keys=KEYS):
    """The policies of several trainings, as they are loaded."""
    agent = MOPG(hidden_sizes=(8,), spec=spec_of_sizes(observation_size, 1))
    return jax.jit(jax.vmap(lambda key: untrained_policy(agent, key)))(keys)


class Arrives(Counter):
    """Reaches its goal at the fifth step, where the observed serial number is below a half."""

    traces = 0  # how often a program that steps it was traced, and so compiled

    def reset(self, rng):
        state: Any = super().reset(rng)
        return state.replace(metrics={"success": jnp.zeros(())})

    def step(self, state, action):
        Arrives.traces += 1
        state = super().step(state, action)
        reached = (state.obs[0] >= 5) & (state.obs[1] < 0.5)
        return state.replace(metrics={"success": reached.astype(float)})


@functools.partial(jax.jit, static_argnums=(0, 2))
def first_observations(env, key, number):
    """Those of the episodes that a key starts, [N, O]."""
    key_reset, *_ = jax.random.split(key, 3)
    return jax.vmap(env.reset)(jax.random.split(key_reset, number)).obs


def test_policies_side_by_side_score_as_each_alone_in_one_compilation(monkeypatch):
    monkeypatch.setattr(evaluation, "make_env", lambda **_: Arrives())
    policies, task = untrained(2), {"name": "halfcheetah"}
    together = score_each(policies, task, "warp", 32, list(KEYS))
    for key, scores in zip(KEYS, together, strict=True):
        first_obs = first_observations(Counter(), key, 32)
        np.testing.assert_array_equal(scores.returns, np.full(32, 5.0))
        np.testing.assert_array_equal(scores.lengths, np.full(32, 5))
        np.testing.assert_array_equal(scores.success, first_obs[:, 1] < 0.5)
        assert 0 < scores.success.mean() < 1
    before = Arrives.traces
    score_each(jax.tree.map(lambda x: -x, policies), task, "warp", 32, list(KEYS))
    assert Arrives.traces == before > 0


def test_a_single_episode_has_no_standard_error():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(Scores(np.array([3.0]), np.array([5])).standard_error)
    # deviations -1 and 1: std sqrt(2), over sqrt(2)
    assert Scores(np.array([1.0, 3.0]), np.array([5, 5])).standard_error == pytest.approx(1.0)


@pytest.mark.whole
def test_engines_and_gymnasium_agree():
    """An untrained policy drops the pole after a few steps, in every engine alike."""
    policies = untrained(4, KEYS[:1])
    scores = [score_each(policies, PENDULUM, e, 32, [KEYS[0]])[0] for e in ("native", "gymnasium")]
    native, gymnasium = scores
    difference = abs(native.returns.mean() - gymnasium.returns.mean())
    assert difference < 3 * np.hypot(native.standard_error, gymnasium.standard_error)
    for s in scores:
        # v5 gives 1 for every step but the one that ends the episode.
        np.testing.assert_array_equal(s.returns, s.lengths - 1)


def test_mistakes_are_explained():
    policies, keys = untrained(2), list(KEYS)
    with pytest.raises(UsageError, match="did you mean 'gymnasium'"):
        score_each(policies, PENDULUM, "gymnasum", 1, keys)
    with pytest.raises(UsageError, match="episodes = 0 must be a positive whole number"):
        score_each(policies, PENDULUM, "native", 0, keys)
    with pytest.raises(UsageError, match=r"The policy observes arrays \[2\]; the task has .*4"):
        score_each(policies, PENDULUM, "native", 1, keys)
