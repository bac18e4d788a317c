"""Seeds as an axis of one compiled program, spread over the devices."""

from typing import Any, TypeAlias

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from hitmdp_jax.training.program import Init, Iterate

AXIS = "seed"
Device: TypeAlias = Any  # a jax.Device, which type checkers do not see as a class


def devices_for(num_seeds: int) -> list[Device]:
    """Return the devices a sweep runs on: as many as divide its seeds evenly."""
    devices = jax.local_devices()
    return devices[: num_shards(num_seeds, len(devices))]


def num_shards(num_seeds: int, num_devices: int) -> int:
    """Return how many of the devices divide the seeds evenly, at most."""
    return max(n for n in range(1, num_devices + 1) if num_seeds % n == 0)


def sweep(init: Init, step: Iterate, devices: list[Device]) -> tuple[Init, Iterate]:
    """Map a training run over a leading axis of keys, sharded over devices, compiled.

    XLA's CPU back end runs programs this small on one core; presented as devices, the cores share
    the seeds. Nothing crosses between devices.

    Args:
      init: `init(key) -> TrainState` of one run.
      step: `step(TrainState) -> (TrainState, metrics)` of one run.
      devices: where to run; their number divides the number of keys.

    Returns:
      The same two functions of keys [S] and states [S, ...].
    """
    # A seed's initialisation is many small factorisations and runs once: one seed after another,
    # since batches of them can starve XLA's CPU thread pool for ever.
    functions = (lambda keys: jax.lax.map(init, keys), jax.vmap(step))
    if len(devices) == 1:
        return tuple(jax.jit(f) for f in functions)  # pyright: ignore[reportReturnType]
    mesh = Mesh(np.array(devices), (AXIS,))
    specs = {"mesh": mesh, "in_specs": P(AXIS), "out_specs": P(AXIS)}
    return tuple(  # pyright: ignore[reportReturnType]
        jax.jit(jax.shard_map(f, **specs, check_vma=False)) for f in functions
    )


def place(tree: Any, devices: list[Device]) -> Any:
    """Lay arrays [S, ...] out over the devices."""
    return jax.device_put(tree, NamedSharding(Mesh(np.array(devices), (AXIS,)), P(AXIS)))
