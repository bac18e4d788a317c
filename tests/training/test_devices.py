import dataclasses
import os
import pickle
import subprocess
import sys

import jax
import numpy as np
import pytest

from hitmdp_jax.envs.physics import native
from hitmdp_jax.errors import UsageError
from hitmdp_jax.mesh import DATA, TRIAL
from hitmdp_jax.training import devices
from hitmdp_jax.training.checkpoint import Progress
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.devices import chunk_size, make_mesh, num_shards, place
from hitmdp_jax.training.run import Run
from tests.probes import QUICK

# Two trainings, each on two of four devices: what one iteration makes of them, into a file.
FOUR_DEVICES = """
import pickle, sys, jax
jax.config.update("jax_num_cpu_devices", 4)
from tests.training.test_devices import after_an_iteration, config
from hitmdp_jax.training.run import Run

run = Run.create(config(seeds=2, data_devices=2))
assert dict(run.mesh.shape) == {"trial": 2, "data": 2}
result = after_an_iteration(run, *run.programs(0))
with open(sys.argv[1], "wb") as file:
    pickle.dump([jax.tree.leaves(result), sorted(run.envs[0].physics._idle)], file)
"""


@pytest.mark.parametrize(
    ("trainings", "devices", "shards"),
    [(1, 2, 1), (2, 2, 2), (3, 2, 2), (10, 2, 2), (5, 16, 5), (17, 16, 9), (40, 16, 14)],
)
def test_no_device_has_more_trainings_than_it_must(trainings, devices, shards):
    assert num_shards(trainings, devices) == shards
    assert -(-trainings // shards) == -(-trainings // devices)


def test_the_last_training_is_repeated_where_they_do_not_divide():
    x = place({"a": np.arange(3), "key": jax.random.split(jax.random.key(0), 3)}, make_mesh(3))
    np.testing.assert_array_equal(x["a"], [0, 1, 2, 2])
    assert len(x["key"].sharding.device_set) == 2
    np.testing.assert_array_equal(*jax.random.key_data(x["key"])[2:])


@pytest.mark.parametrize(
    ("trainings", "data", "shape"), [(1, 1, (1, 1)), (3, 1, (2, 1)), (3, 2, (1, 2))]
)
def test_a_mesh_has_an_axis_of_trainings_and_one_of_their_environments(trainings, data, shape):
    assert tuple(make_mesh(trainings, data).shape.items()) == ((TRIAL, shape[0]), (DATA, shape[1]))


@pytest.mark.parametrize("data", [3, 4])
def test_devices_that_cannot_be_shared_out_are_refused(data):
    with pytest.raises(UsageError, match=f"data_devices = {data} does not divide the 2 devices"):
        make_mesh(1, data)


def config(**settings):
    return RunConfig.from_mapping(QUICK | settings)


def after_an_iteration(run, init, step):
    state, metrics = step(run.begin(0, Progress(0, 0, None), init))
    state = state.replace(key=jax.random.key_data(state.key))
    return jax.device_get(run.own((state, metrics)))


def test_seeds_on_two_devices_equal_seeds_on_one():
    """Three seeds, which two devices do not divide, and each of them alone."""
    run, alone = Run.create(config(seeds=3)), Run.create(config())
    assert [x.mesh.size for x in (run, alone)] == [2, 1]
    together = after_an_iteration(run, *run.programs(0))
    assert len(together[1]["action_kl"]) == 3
    program = alone.programs(0)
    for seed in range(3):
        one = after_an_iteration(dataclasses.replace(alone, config=config(seed=seed)), *program)
        here = jax.tree.map(lambda x, i=seed: x[i : i + 1], together)
        assert_alike(here, one)


def assert_alike(one, other):
    for x, y in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-5)


@pytest.fixture(scope="module")
def on_one_device():
    """Two trainings after an iteration on one device."""
    run = Run.create(config(seeds=2))
    run = dataclasses.replace(run, mesh=make_mesh(1))
    return after_an_iteration(run, *run.programs(0))


def test_environments_on_two_devices_equal_environments_on_one(on_one_device, monkeypatch):
    """State, parameters, normaliser and metrics; and each device steps its own half."""
    whole, rows_seen = native._Pool.run, set()

    def watched(pool, what, rows, out):
        rows_seen.add(len(rows))
        whole(pool, what, rows, out)

    monkeypatch.setattr(native._Pool, "run", watched)
    run = Run.create(config(seeds=2, data_devices=2))
    assert_alike(after_an_iteration(run, *run.programs(0)), on_one_device)
    assert {16, 32} & rows_seen == {16}  # eight environments of each training, not all sixteen


def test_four_devices_equal_one(on_one_device, tmp_path):
    cache = {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir, "NPROC": "4"}
    command = [sys.executable, "-c", FOUR_DEVICES, str(tmp_path / "result")]
    out = subprocess.run(command, env=os.environ | cache, capture_output=True, text=True)
    assert out.returncode == 0, out.stderr
    result, rows = pickle.loads((tmp_path / "result").read_bytes())
    assert_alike(result, on_one_device)
    assert {8, 16} & set(rows) == {8}


@pytest.mark.parametrize(("trainings", "size"), [(1, 1), (8, 8), (9, 3), (11, 1), (20, 5), (64, 8)])
def test_chunks_are_of_one_size(trainings, size):
    assert chunk_size(trainings) == size


def test_seeds_in_chunks_equal_seeds_side_by_side(monkeypatch):
    run = Run.create(config(seeds=4))  # two on each of two devices
    together = after_an_iteration(run, *run.programs(0))
    monkeypatch.setattr(devices, "SIDE_BY_SIDE", 1)
    one_by_one = after_an_iteration(run, *run.programs(0))
    assert_alike(together, one_by_one)
