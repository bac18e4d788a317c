"""How a command line sets JAX up on its machine, before the first computation."""

import os
from pathlib import Path

import jax

CACHE = Path.home() / ".cache" / "hitmdp_jax"
# XLA's CPU back end factorises batches up to about this size without its thread pool.
SMALL_BATCH = 64


def set_up_host(batch: int) -> None:
    """Present the cores as devices, keep what is compiled, and make sure that no batch hangs.

    In jaxlib 0.10 a large batch of Cholesky factorisations, which MJX's solver consists of, blocks
    a thread of XLA's pool until other threads have done its parts. There are as many threads as
    cores: as many factorisations at once wait for one another for ever. `NPROC` is how many cores
    XLA believes in. With four times as many threads MJX is a tenth slower, so small batches, which
    never wait, go without.

    Args:
      batch: environments stepped together.
    """
    cores = os.cpu_count() or 1
    jax.config.update("jax_num_cpu_devices", cores)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(CACHE))
    if batch > SMALL_BATCH:
        os.environ.setdefault("NPROC", str(4 * cores))
