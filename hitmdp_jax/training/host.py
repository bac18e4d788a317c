"""How a command line sets JAX up on its machine, before the first computation."""

import os
from pathlib import Path

import jax

from hitmdp_jax.envs.physics import find_engine
from hitmdp_jax.envs.vector import RESET_CHUNK
from hitmdp_jax.machine import available_cores
from hitmdp_jax.training.devices import num_shards

CACHE = Path.home() / ".cache" / "hitmdp_jax"
THREADS_PER_CORE = 4


def set_up_host(physics: str, num_envs: int, trainings: int = 1) -> None:
    """Present the cores as devices, keep what is compiled, and make sure that nothing hangs.

    In jaxlib 0.10 a large batch of Cholesky factorisations, of which MJX's solver consists, blocks
    a thread of XLA's pool until other threads have done its work. There are as many threads as
    cores, so as many of these at once wait for one another for ever. `NPROC` is how many cores XLA
    believes in. More threads cost a fifth to a third of the speed, so only runs that need them get
    them.

    Args:
      physics: the engine, which knows how many rows are safe (`Engine.safe_rows`).
      num_envs: environments of each training, stepped side by side.
      trainings: trainings, spread over the cores.
    """
    cores = available_cores()
    jax.config.update("jax_num_cpu_devices", cores)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(CACHE))
    rows = max(num_envs, RESET_CHUNK) * -(-trainings // num_shards(trainings, cores))
    safe = find_engine(physics).safe_rows
    if safe is not None and rows > safe:
        os.environ.setdefault("NPROC", str(THREADS_PER_CORE * cores))
