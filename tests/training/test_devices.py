import dataclasses

import jax
import numpy as np
import pytest

from hitmdp_jax.training.checkpoint import Progress
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.devices import num_shards, place
from hitmdp_jax.training.run import Run

SMALL = {"name": "ppo", "num_epochs": 1, "hidden_sizes": [8]}
PENDULUM = {"name": "invertedpendulum"}


@pytest.mark.parametrize(
    ("trainings", "devices", "shards"),
    [(1, 2, 1), (2, 2, 2), (3, 2, 2), (10, 2, 2), (5, 16, 5), (17, 16, 9), (40, 16, 14)],
)
def test_no_device_has_more_trainings_than_it_must(trainings, devices, shards):
    assert num_shards(trainings, devices) == shards
    assert -(-trainings // shards) == -(-trainings // devices)


def test_the_last_training_is_repeated_where_they_do_not_divide():
    x = place({"a": np.arange(3), "key": jax.random.split(jax.random.key(0), 3)}, jax.devices())
    np.testing.assert_array_equal(x["a"], [0, 1, 2, 2])
    assert len(x["key"].sharding.device_set) == 2
    np.testing.assert_array_equal(*jax.random.key_data(x["key"])[2:])


def test_seeds_on_two_devices_equal_seeds_on_one():
    """Three seeds, which two devices do not divide."""
    config = RunConfig.from_mapping(
        {"algo": SMALL, "env": PENDULUM, "physics": "native", "seeds": 3, "total_steps": 64,
         "num_envs": 4, "rollout_length": 16}
    )  # fmt: skip
    results = []
    for devices in (jax.devices()[:1], jax.devices()):
        run = dataclasses.replace(Run.create(config), devices=devices)
        init, step = run.programs(0)
        state, metrics = step(run.begin(0, Progress(0, 0, None), init))
        results.append(run.own((jax.tree.leaves(state.learner), metrics["action_kl"])))
        assert len(results[-1][1]) == 3
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-5), *results)
