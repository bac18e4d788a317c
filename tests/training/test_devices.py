import jax
import numpy as np
import pytest

from hitmdp_jax.training.checkpoint import Progress
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.devices import num_shards, place
from hitmdp_jax.training.run import Run

# The runs of tests/commands, which are compiled once for both.
QUICK = {
    "algo": {"name": "ppo", "num_epochs": 1},
    "env": {"name": "invertedpendulum"},
    "physics": "native",
}


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


def learned(**settings):
    run = Run.create(RunConfig.from_mapping(QUICK | settings))
    init, step = run.programs(0)
    state, metrics = step(run.begin(0, Progress(0, 0, None), init))
    state = state.replace(key=jax.random.key_data(state.key))
    return jax.device_get(run.own((state, metrics)))


def test_a_seed_among_others_on_two_devices_equals_the_seed_alone():
    """Three of them, which two devices do not divide."""
    together = learned(seeds=3)
    for i, seed in ((0, 0), (2, 2)):
        alone = learned(seeds=1, seed=seed)
        here = jax.tree.map(lambda x, i=i: x[i : i + 1], together)
        jax.tree.map(
            lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-4), here, alone
        )
