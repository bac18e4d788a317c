import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.acme import running_statistics

from hitmdp_jax.agents import MOPG
from hitmdp_jax.analysis.evaluation import score, score_in_jax
from hitmdp_jax.errors import UsageError
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.policy import Policy
from tests.probes import Counter
from tests.training.test_config import SETTINGS


def untrained(observation_size, action_size, key):
    agent = MOPG()
    params = agent.init(key, observation_size, action_size).params
    return Policy(agent, params, running_statistics.init_state(jnp.zeros(observation_size)))


def test_each_environment_scores_its_first_whole_episode(key):
    scores = score_in_jax(untrained(2, 1, key), Counter(), 3, key)
    np.testing.assert_array_equal(scores.returns, [5.0, 5.0, 5.0])
    np.testing.assert_array_equal(scores.lengths, [5, 5, 5])


def test_engines_and_gymnasium_agree(key):
    """An untrained policy drops the pole after a few steps, in every engine alike."""
    config = RunConfig.from_mapping(SETTINGS | {"env": {"name": "invertedpendulum"}})
    policy = untrained(4, 1, key)
    scores = {e: score(policy, config, e, 64, key) for e in ("native", "gymnasium")}
    native, gymnasium = scores["native"], scores["gymnasium"]
    difference = abs(native.returns.mean() - gymnasium.returns.mean())
    assert difference < 3 * np.hypot(native.standard_error, gymnasium.standard_error)
    for s in scores.values():
        # v5 gives 1 for every step but the one that ends the episode.
        np.testing.assert_array_equal(s.returns, s.lengths - 1)


def test_mistakes_are_explained(key):
    config = RunConfig.from_mapping(SETTINGS)
    with pytest.raises(UsageError, match="did you mean 'gymnasium'"):
        score(untrained(17, 6, key), config, "gym", 1, key)
    with pytest.raises(UsageError, match="episodes = 0 must be a positive whole number"):
        score(untrained(17, 6, key), config, "native", 0, key)


def test_the_command_explains_a_missing_run():
    command = [sys.executable, "-m", "hitmdp_jax.evaluate", "nowhere"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 2
    assert result.stderr == "error: 'nowhere' is not a run's folder: it has no config.yaml.\n"
