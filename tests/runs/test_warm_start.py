"""What a run begins with is read as arrays alone, whoever wrote it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml

import hitmdp_jax
from hitmdp_jax.agents import PPO
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.saving import extract
from hitmdp_jax.runs.warm_start import read_start
from hitmdp_jax.training.warm_start import PARTS
from tests.probes import untrained

AGENT = PPO(hidden_sizes=(8,))


@pytest.fixture
def states():
    """Three trainings, whose arrays hold their places."""
    states = untrained(AGENT, 3).replace(iteration=jnp.full(3, 7))
    numbered = jax.tree.map(
        lambda x: np.broadcast_to(np.arange(3, dtype=x.dtype).reshape(3, *[1] * (x.ndim - 1)),
                                  x.shape),
        (states.learner, states.normalizer),
    )  # fmt: skip
    return states.replace(learner=numbered[0], normalizer=numbered[1])


@pytest.fixture
def one():
    return jax.tree.map(lambda x: x[0], untrained(AGENT, 1))


@pytest.fixture
def saved(states, tmp_path):
    hitmdp_jax.save(tmp_path / "run", AGENT, states)
    return tmp_path / "run"


def test_each_training_begins_with_one_of_the_source_and_so_round_again(saved, one):
    start = read_start(saved, one, PARTS)
    assert (start.number, start.iteration, start.fit.anew) == (3, 7, [])
    own = start.put(untrained(AGENT, 5), start.of(np.arange(5)))
    for x in jax.tree.leaves((own.learner, own.normalizer)):
        np.testing.assert_array_equal(x.reshape(5, -1)[:, 0], [0, 1, 2, 0, 1])
    assert start.told(one) == f"Begins with 3 trainings in {saved}, after iteration 7."


def test_a_file_of_one_policy_has_all_but_the_optimiser(saved, one, tmp_path):
    extract(saved, tmp_path / "one.policy", seed=2)
    start = read_start(tmp_path / "one.policy", one, PARTS)
    assert start.told(one).endswith("after iteration 7; starting anew: optimizer.")
    own = start.put(untrained(AGENT, 2), start.of(np.zeros(2, int)))
    for x in jax.tree.leaves((own.learner.params, own.normalizer.mean)):
        np.testing.assert_array_equal(x, 2)


def test_a_strangers_settings_are_not_even_read(saved, one, tmp_path):
    (tmp_path / "evil.py").write_text("raise SystemExit('run')")
    evil = f"{tmp_path}/evil.py:Evil"
    settings = {"schema": 3, "algo": {"name": evil}, "env": {"name": evil}, "callbacks": [evil]}
    (saved / "config.yaml").write_text(yaml.safe_dump(settings))
    assert read_start(saved, one, PARTS).number == 3


def test_a_source_of_which_nothing_fits_is_named(saved):
    small = jax.tree.map(lambda x: x[0], untrained(PPO(hidden_sizes=(4,)), 1))
    with pytest.raises(UsageError, match=f"init_from = {saved}: nothing fits"):
        read_start(saved, small, ("policy",))
