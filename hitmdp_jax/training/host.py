"""How a command line sets JAX up on its machine, before the first computation."""

import contextlib
import os
from pathlib import Path

import jax

from hitmdp_jax.envs.physics import find_engine
from hitmdp_jax.envs.vector import RESET_CHUNK
from hitmdp_jax.machine import available_cores
from hitmdp_jax.training.devices import num_shards

THREADS_PER_CORE = 4


def set_up_host(physics: str, num_envs: int, trainings: int = 1, data_devices: int = 1) -> None:
    """Present the cores as devices, keep what is compiled, and make sure that nothing hangs.

    `NPROC` is how many cores XLA believes in, which is how many threads each program spreads its
    operations over. Those of a training are so small that handing them over takes longer than doing
    them: a device has one thread, and one training one device unless more are asked for, which
    makes it a fifth to a third faster than on all cores.

    In jaxlib 0.10 a large batch of Cholesky factorisations, of which MJX's solver consists, blocks
    a thread of XLA's pool until other threads have done its work, and as many of these at once as
    there are threads wait for one another for ever. Runs with batches so large get more threads.

    Args:
      physics: the engine, which knows how many rows are safe (`Engine.safe_rows`).
      num_envs: environments of each training, stepped side by side.
      trainings: trainings, spread over the cores.
      data_devices: devices that share the environments of a training.
    """
    cores = available_cores()
    shards = num_shards(trainings, max(1, cores // data_devices))
    devices = shards * data_devices
    jax.config.update("jax_num_cpu_devices", devices)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        with contextlib.suppress(RuntimeError):  # a user without a home keeps nothing
            cache = Path.home() / ".cache" / "hitmdp_jax"
            jax.config.update("jax_compilation_cache_dir", str(cache))
    rows = max(num_envs // data_devices, RESET_CHUNK) * -(-trainings // shards)
    safe = find_engine(physics).safe_rows
    unsafe = safe is not None and rows > safe
    os.environ.setdefault("NPROC", str(THREADS_PER_CORE * cores if unsafe else devices))
