import dataclasses
import os
import pickle
import subprocess
import sys
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from flax import struct

from hitmdp_jax.errors import UsageError
from hitmdp_jax.mesh import DATA, TRIAL
from hitmdp_jax.physics import pool
from hitmdp_jax.runs import devices
from hitmdp_jax.runs.checkpoint import Progress
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.devices import chunk_size, make_mesh, memory_of, num_shards, place, spread
from hitmdp_jax.runs.run import Run
from hitmdp_jax.training.host_loop import compiled
from tests.probes import QUICK

# Two trainings, each on two of four devices: what one iteration makes of them, into a file.
FOUR_DEVICES = """
import pickle, sys, jax
jax.config.update("jax_num_cpu_devices", 4)
from tests.runs.test_devices import after_an_iteration, config
from hitmdp_jax.runs.run import Run

run = Run.create(config(seeds=2, data_devices=2))
assert dict(run.mesh.shape) == {"trial": 2, "data": 2}
result = after_an_iteration(run, *run.programs(0))
with open(sys.argv[1], "wb") as file:
    pickle.dump([jax.tree.leaves(result), sorted(n for n, _ in run.envs[0].physics._idle)], file)
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


@pytest.fixture(scope="module")
def alone():
    """Three trainings after an iteration, each alone on one device."""
    run = Run.create(config())
    assert run.mesh.size == 1
    program = run.programs(0)
    runs = [dataclasses.replace(run, config=config(seed=seed)) for seed in range(3)]
    results = [after_an_iteration(one, *program) for one in runs]
    return jax.tree.map(lambda *x: np.concatenate(x), *results)


def assert_alike(some, all_of_them):
    """Check that some trainings are the first ones of all of them."""
    for x, y in zip(jax.tree.leaves(some), jax.tree.leaves(all_of_them), strict=True):
        np.testing.assert_allclose(x, y[: len(x)], rtol=1e-3, atol=1e-5)


SIZES = [devices.SIDE_BY_SIDE, pytest.param(1, marks=pytest.mark.slow)]


@pytest.mark.parametrize("side_by_side", SIZES)
@pytest.mark.whole
def test_seeds_on_two_devices_equal_each_alone(side_by_side, alone, monkeypatch):
    """Three seeds, which two devices do not divide; a device's two at once, or one by one."""
    monkeypatch.setattr(devices, "SIDE_BY_SIDE", side_by_side)
    run = Run.create(config(seeds=3))
    assert run.mesh.size == 2
    together = after_an_iteration(run, *run.programs(0))
    assert len(together[1]["action_kl"]) == 3
    assert_alike(together, alone)


@pytest.mark.whole
def test_environments_on_two_devices_equal_environments_on_one(alone, monkeypatch):
    """State, parameters, normaliser and metrics; and each device steps its own half."""
    whole, rows_seen = pool.Pool.run, set()

    def watched(self, what, rows, out):
        rows_seen.add(len(rows))
        whole(self, what, rows, out)

    monkeypatch.setattr(pool.Pool, "run", watched)
    run = Run.create(config(seeds=2, data_devices=2))
    together = after_an_iteration(run, *run.programs(0))
    assert len(together[1]["action_kl"]) == 2
    assert_alike(together, alone)
    assert {16, 32} & rows_seen == {16}  # eight environments of each training, not all sixteen


@pytest.mark.slow
def test_four_devices_equal_one(alone, tmp_path):
    """Seeds and their environments at once; the two tests above spread one of them each."""
    cache = {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir, "NPROC": "4"}
    command = [sys.executable, "-c", FOUR_DEVICES, str(tmp_path / "result")]
    out = subprocess.run(command, env=os.environ | cache, capture_output=True, text=True)
    assert out.returncode == 0, out.stderr
    result, rows = pickle.loads((tmp_path / "result").read_bytes())
    assert_alike(result, alone)
    assert {8, 16} & set(rows) == {8}


@pytest.mark.parametrize(("trainings", "size"), [(1, 1), (8, 8), (9, 3), (11, 1), (20, 5), (64, 8)])
def test_chunks_are_of_one_size(trainings, size):
    assert chunk_size(trainings) == size


class Walk(struct.PyTreeNode):
    """What `spread` needs of a state: trainings that differ in every iteration."""

    iteration: jax.Array
    place: jax.Array
    nothing: jax.Array  # without entries, as the states of some simulators have arrays
    replay: tuple = ()


def walk_on(state):
    key = jax.random.fold_in(jax.random.key(0), state.iteration)
    place = state.place * jax.random.normal(key)
    return Walk(state.iteration + 1, place, state.nothing), {"place": place}


@pytest.mark.parametrize("seeds", [3, 6])
def test_trainings_in_chunks_equal_trainings_side_by_side(seeds, monkeypatch):
    """Also of real ones, in a slow case of the test of seeds."""
    mesh, together = make_mesh(seeds), {}
    at = np.linspace(1, 2, seeds, dtype=np.float32)
    begun = place(Walk(np.arange(seeds), at, np.zeros((seeds, 0, 3))), mesh)
    for size in (8, 1):
        monkeypatch.setattr(devices, "SIDE_BY_SIDE", size)
        together[size] = spread(lambda key, more: begun, walk_on, mesh)[1](begun)
    jax.tree.map(np.testing.assert_array_equal, together[8], together[1])
    expected = [walk_on(jax.tree.map(lambda x, i=i: x[i], begun)) for i in range(seeds)]
    for i, one in enumerate(expected):
        here = jax.tree.map(lambda x, i=i: x[i], together[1])
        jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-6), here, one)


def test_a_compiled_iteration_goes_on_with_what_it_returned():
    """Arrays without entries as well, which XLA lays out as it likes."""
    mesh = make_mesh(4)
    begun = place(Walk(np.arange(4), np.ones(4, np.float32), np.zeros((4, 0, 3))), mesh)
    step = compiled(spread(lambda key, more: begun, walk_on, mesh)[1], begun)  # type: ignore
    once, _ = step(begun)
    twice, _ = step(once)
    np.testing.assert_array_equal(twice.iteration, np.arange(4) + 2)


@pytest.mark.parametrize(("told", "has"), [({"bytes_limit": 10}, 40), ({}, None), (None, None)])
def test_accelerators_have_the_memory_that_each_says_it_has(told, has):
    device = SimpleNamespace(platform="gpu", memory_stats=lambda: told)
    mesh = SimpleNamespace(local_devices=[device] * 2, size=4)  # of two processes
    assert memory_of(mesh) == has  # pyright: ignore[reportArgumentType]
