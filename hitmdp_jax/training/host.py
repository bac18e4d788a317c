"""How a command line sets JAX up on its machine, before the first computation."""

import os
from pathlib import Path

import jax

CACHE = Path.home() / ".cache" / "hitmdp_jax"
THREADS_PER_CORE = 4


def set_up_host() -> None:
    """Present the cores as devices, keep what is compiled, and make sure that nothing hangs.

    In jaxlib 0.10 two things block a thread of XLA's pool until other threads have done their work:
    a batch of more than about 64 Cholesky factorisations, of which MJX's solver consists, and a
    callback to the host, `physics=native`, whose arguments are large enough to be copied aside.
    There are as many threads as cores, so as many of these at once wait for one another for ever.
    `NPROC` is how many cores XLA believes in. With more threads MJX is a tenth slower in small
    batches; a run that stops in the night costs more.
    """
    cores = os.cpu_count() or 1
    jax.config.update("jax_num_cpu_devices", cores)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(CACHE))
    os.environ.setdefault("NPROC", str(THREADS_PER_CORE * cores))
