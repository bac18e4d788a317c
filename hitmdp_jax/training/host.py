"""How a command line sets JAX up on its machine, before the first computation."""

import os
from pathlib import Path

import jax

from hitmdp_jax.envs.physics import ENGINES
from hitmdp_jax.envs.vector import RESET_CHUNK
from hitmdp_jax.training.sweep import num_shards

CACHE = Path.home() / ".cache" / "hitmdp_jax"
THREADS_PER_CORE = 4


def set_up_host(physics: str, num_envs: int, seeds: int = 1) -> None:
    """Present the cores as devices, keep what is compiled, and make sure that nothing hangs.

    In jaxlib 0.10 two things block a thread of XLA's pool until other threads have done their work:
    a large batch of Cholesky factorisations, of which MJX's solver consists, and a callback to the
    host, `physics=native`, with large arguments. There are as many threads as cores, so as many of
    these at once wait for one another for ever. `NPROC` is how many cores XLA believes in. More
    threads cost a fifth to a third of the speed, so only runs that need them get them.

    Args:
      physics: the engine.
      num_envs: environments of each seed, stepped side by side.
      seeds: seeds, spread over the cores.
    """
    cores = os.cpu_count() or 1
    jax.config.update("jax_num_cpu_devices", cores)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(CACHE))
    seeds_together = seeds // num_shards(seeds, cores)
    safe_rows = ENGINES[physics].safe_rows if physics in ENGINES else None  # Gymnasium's is none
    if safe_rows is not None and max(num_envs, RESET_CHUNK) * seeds_together > safe_rows:
        os.environ.setdefault("NPROC", str(THREADS_PER_CORE * cores))
