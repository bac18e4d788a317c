"""Trainings, and the environments of each, spread over the devices of one compiled program."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from hitmdp_jax.checks import divisor_below, memory
from hitmdp_jax.errors import UsageError
from hitmdp_jax.mesh import DATA, TRIAL, in_chunks
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.runs import processes
from hitmdp_jax.training.program import Init, Iterate
from hitmdp_jax.training.state import Hyperparameters, TrainState

# Trainings that a CPU device runs side by side. More are no faster, and need memory for the
# rollouts of all: 32 seeds of MOPG make as many steps per second in chunks as at once.
SIDE_BY_SIDE = 8


def make_mesh(num_trainings: int, data_devices: int = 1) -> Mesh:
    """Return the mesh [trial, data] of the devices that a run takes, of all processes the same.

    As many trainings at once as keeps each device's number of them the least, and at least one
    device of every process.

    Args:
      num_trainings: trainings, which share the `trial` axis.
      data_devices: devices that share the environments of one training.

    Raises:
      UsageError: the devices cannot be shared out so.
    """
    devices = jax.devices()
    if data_devices > len(devices) or len(devices) % data_devices:
        near = divisor_below(len(devices), data_devices)
        raise UsageError(
            f"data_devices = {data_devices} does not divide the {len(devices)} devices here; the "
            f"nearest number below that does is {near}."
        )
    count, rows = jax.process_count(), len(devices) // data_devices
    least = min(num_trainings, -(-count // data_devices))
    size = max(num_shards(num_trainings, rows), least) * data_devices
    if size < count:
        raise UsageError(
            f"{count} processes are more than the {size} devices that the run takes; give "
            f"seeds={count} or data_devices={count}, or start fewer."
        )
    spread_out = [devices[i * len(devices) // size] for i in range(size)]
    return Mesh(np.array(spread_out).reshape(-1, data_devices), (TRIAL, DATA))


def num_shards(num_trainings: int, num_devices: int) -> int:
    """Return over how many of the devices trainings are spread; the last one may have fewer."""
    each = -(-num_trainings // num_devices)
    return -(-num_trainings // each)


def chunk_size(trainings: int) -> int:
    """Return how many of a CPU device's trainings run side by side, in chunks of one size."""
    return max(size for size in range(1, SIDE_BY_SIDE + 1) if trainings % size == 0)


def at_once(trainings: int, mesh: Mesh) -> int:
    """Return how many of the trainings collect their rollouts at once."""
    if mesh.devices.flat[0].platform != "cpu":
        return trainings
    shards = mesh.shape[TRIAL]
    return min(trainings, shards * chunk_size(-(-trainings // shards)))


def memory_of(mesh: Mesh) -> int | None:
    """Return the bytes of memory that a mesh's devices have together; None where they don't say."""
    device = mesh.local_devices[0]
    if device.platform == "cpu":
        return memory() * jax.process_count()
    limit = (device.memory_stats() or {}).get("bytes_limit")
    return limit and limit * mesh.size


def spread(init: Init, step: Iterate, mesh: Mesh) -> tuple[Init, Iterate]:
    """Map a training over a leading axis, spread over a mesh, compiled.

    XLA's CPU back end runs programs this small on one core; presented as devices, the cores share
    the trainings, and each runs its own in chunks. Nothing crosses between trainings. Over `data`,
    XLA partitions each training by its environments (`hitmdp_jax.mesh`).

    Args:
      init: `init(key, hyperparameters) -> TrainState` of one training.
      step: `step(TrainState) -> (TrainState, metrics)` of one training.
      mesh: where to run.

    Returns:
      The same two functions of keys [R], hyperparameters [R] and states [R, ...], which `place`
      laid out over the devices. Between two steps every device of `data` has the whole state, which
      is small beside a rollout.
    """
    on_cpu = mesh.devices.flat[0].platform == "cpu"

    # A training's initialisation is many small factorisations and runs once: one after another,
    # since batches of them can starve XLA's CPU thread pool for ever.
    def inits(keys: jax.Array, hyperparameters: Hyperparameters) -> TrainState:
        return jax.lax.map(lambda one: init(*one), (keys, hyperparameters))

    def steps(states: TrainState) -> tuple[TrainState, Metrics]:
        trainings = len(states.iteration)
        size = chunk_size(trainings) if on_cpu else trainings
        return in_chunks(step, states, size)

    if mesh.size == 1:
        return jax.jit(inits), jax.jit(steps)
    by_hand = {TRIAL} if mesh.shape[DATA] > 1 else {TRIAL, DATA}

    def compiled(function: Callable[..., Any], out: Any) -> Any:
        by_trial = jax.shard_map(
            function,
            mesh=mesh,
            in_specs=P(TRIAL),
            out_specs=P(TRIAL),
            axis_names=by_hand,
            check_vma=False,
        )
        return jax.jit(by_trial, in_shardings=_layout(mesh), out_shardings=out)

    # Each process reports, so to speak: metrics are whole in all of them.
    told = NamedSharding(mesh, P()) if processes.several() else _layout(mesh)
    return compiled(inits, _layout(mesh)), compiled(steps, (_layout(mesh), told))


def place(tree: Any, mesh: Mesh) -> Any:
    """Lay arrays [R, ...] out over the trials, the last one repeated where they do not divide."""

    def even(x: Any) -> Any:
        missing = -len(x) % mesh.shape[TRIAL]
        return jnp.concatenate([x, *([x[-1:]] * missing)]) if missing else x

    tree = jax.tree.map(even, tree)
    if not processes.several():
        return jax.device_put(tree, _layout(mesh))
    return jax.tree.map(lambda x: _placed_by_all(x, mesh), tree)


def _placed_by_all(x: Any, mesh: Mesh) -> jax.Array:
    """Lay out an array that every process has, each its own part of it."""
    if isinstance(x, jax.Array):
        if not x.is_fully_addressable:
            return x  # it came out of `spread`, laid out already
        if jnp.issubdtype(x.dtype, jax.dtypes.prng_key):
            return jax.random.wrap_key_data(_placed_by_all(jax.random.key_data(x), mesh))
    whole = np.asarray(x)
    return jax.make_array_from_callback(whole.shape, _layout(mesh), lambda part: whole[part])


def _layout(mesh: Mesh) -> NamedSharding:
    return NamedSharding(mesh, P(TRIAL))
