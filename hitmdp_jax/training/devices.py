"""Trainings as an axis of one compiled program, spread over the devices."""

from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from hitmdp_jax.learning.metrics import Metrics
from hitmdp_jax.training.program import Hyperparameters, Init, Iterate, TrainState

AXIS = "training"
# Trainings that a CPU device runs side by side. More are no faster, and need memory for the
# rollouts of all: 32 seeds of MOPG make as many steps a second in chunks as at once.
SIDE_BY_SIDE = 8
Device: TypeAlias = Any  # a jax.Device, which type checkers do not see as a class


def devices_for(num_trainings: int) -> list[Device]:
    """Return the devices a run takes: so many that none has more trainings than it must."""
    devices = jax.local_devices()
    return devices[: num_shards(num_trainings, len(devices))]


def num_shards(num_trainings: int, num_devices: int) -> int:
    """Return over how many of the devices trainings are spread; the last one may have fewer."""
    each = -(-num_trainings // num_devices)
    return -(-num_trainings // each)


def chunk_size(trainings: int) -> int:
    """Return how many of a CPU device's trainings run side by side, in chunks of one size."""
    return max(size for size in range(1, SIDE_BY_SIDE + 1) if trainings % size == 0)


def spread(init: Init, step: Iterate, devices: list[Device]) -> tuple[Init, Iterate]:
    """Map a training over a leading axis, sharded over devices, compiled.

    XLA's CPU back end runs programs this small on one core; presented as devices, the cores share
    the trainings, and each runs its own in chunks. Nothing crosses between devices.

    Args:
      init: `init(key, hyperparameters) -> TrainState` of one training.
      step: `step(TrainState) -> (TrainState, metrics)` of one training.
      devices: where to run.

    Returns:
      The same two functions of keys [R], hyperparameters [R] and states [R, ...], which `place`
      laid out over the devices.
    """

    # A training's initialisation is many small factorisations and runs once: one after another,
    # since batches of them can starve XLA's CPU thread pool for ever.
    def inits(keys: jax.Array, hyperparameters: Hyperparameters) -> TrainState:
        return jax.lax.map(lambda one: init(*one), (keys, hyperparameters))

    def steps(states: TrainState) -> tuple[TrainState, Metrics]:
        trainings = len(states.iteration)
        size = chunk_size(trainings) if devices[0].platform == "cpu" else trainings
        return jax.lax.map(step, states, batch_size=size)

    functions = (inits, steps)
    if len(devices) == 1:
        return tuple(jax.jit(f) for f in functions)  # pyright: ignore[reportReturnType]
    mesh = Mesh(np.array(devices), (AXIS,))
    specs = {"mesh": mesh, "in_specs": P(AXIS), "out_specs": P(AXIS)}
    return tuple(  # pyright: ignore[reportReturnType]
        jax.jit(jax.shard_map(f, **specs, check_vma=False)) for f in functions
    )


def place(tree: Any, devices: list[Device]) -> Any:
    """Lay arrays [R, ...] out over the devices, the last one repeated where they do not divide."""

    def even(x: Any) -> Any:
        missing = -len(x) % len(devices)
        return jnp.concatenate([x, *([x[-1:]] * missing)]) if missing else x

    sharding = NamedSharding(Mesh(np.array(devices), (AXIS,)), P(AXIS))
    return jax.device_put(jax.tree.map(even, tree), sharding)
