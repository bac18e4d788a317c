import dataclasses

import jax
import numpy as np
import pytest

from hitmdp_jax.training import devices
from hitmdp_jax.training.checkpoint import Progress
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.devices import chunk_size, num_shards, place
from hitmdp_jax.training.run import Run
from tests.probes import QUICK


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


def config(**settings):
    return RunConfig.from_mapping(QUICK | settings)


def after_an_iteration(run, init, step):
    state, metrics = step(run.begin(0, Progress(0, 0, None), init))
    state = state.replace(key=jax.random.key_data(state.key))
    return jax.device_get(run.own((state, metrics)))


def test_seeds_on_two_devices_equal_seeds_on_one():
    """Three seeds, which two devices do not divide, and each of them alone."""
    run, alone = Run.create(config(seeds=3)), Run.create(config())
    assert [len(x.devices) for x in (run, alone)] == [2, 1]
    together = after_an_iteration(run, *run.programs(0))
    assert len(together[1]["action_kl"]) == 3
    program = alone.programs(0)
    for seed in range(3):
        one = after_an_iteration(dataclasses.replace(alone, config=config(seed=seed)), *program)
        here = jax.tree.map(lambda x, i=seed: x[i : i + 1], together)
        jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-5), here, one)


@pytest.mark.parametrize(("trainings", "size"), [(1, 1), (8, 8), (9, 3), (11, 1), (20, 5), (64, 8)])
def test_chunks_are_of_one_size(trainings, size):
    assert chunk_size(trainings) == size


def test_seeds_in_chunks_equal_seeds_side_by_side(monkeypatch):
    run = Run.create(config(seeds=4))  # two on each of two devices
    together = after_an_iteration(run, *run.programs(0))
    monkeypatch.setattr(devices, "SIDE_BY_SIDE", 1)
    one_by_one = after_an_iteration(run, *run.programs(0))
    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-5), together, one_by_one
    )
