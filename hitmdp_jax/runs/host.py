"""How a command line sets JAX up on its machine, before the first computation."""

import contextlib
import os
from pathlib import Path

import jax

from hitmdp_jax.envs.suites import find_suite
from hitmdp_jax.envs.vector import RESET_CHUNK
from hitmdp_jax.errors import UsageError
from hitmdp_jax.machine import available_cores
from hitmdp_jax.physics import find_engine
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.devices import num_shards

THREADS_PER_CORE = 4
MOST_DEVICES = 1024


def present_cores() -> None:
    """Present every core as a device: what any run can do with, before its settings are known.

    A command line does this first of all. A task or an algorithm of the user's own may compute as
    soon as its file is run, and nothing can be set up after that.
    """
    if jax.config.jax_num_cpu_devices < 0:  # pyright: ignore[reportAttributeAccessIssue]
        with contextlib.suppress(RuntimeError):  # JAX computes already
            jax.config.update("jax_num_cpu_devices", available_cores())


def solver_of(config: RunConfig, engine: str) -> str | None:
    """Return the engine whose solver an engine's run steps; None where no task of it solves any."""
    suites = [find_suite(task["name"]) for task in config.tasks]
    return engine if any(suite is None or suite.solves for suite in suites) else None


def set_up_host(
    physics: str | None, num_envs: int, trainings: int = 1, data_devices: int = 1
) -> None:
    """Present the cores as devices, keep what is compiled, and make sure that nothing hangs.

    `NPROC` is how many cores XLA believes in, which is how many threads each program spreads its
    operations over. Those of a training are so small that handing them over takes longer than doing
    them: a device has one thread, and one training one device unless more are asked for, which
    makes it a fifth to a third faster than on all cores.

    In jaxlib 0.10 a large batch of Cholesky factorisations, of which MJX's solver consists, blocks
    a thread of XLA's pool until other threads have done its work, and as many of these at once as
    there are threads wait for one another for ever. Runs with batches so large get more threads.

    Args:
      physics: the engine, which knows how many rows are safe (`Engine.safe_rows`); see `solver_of`.
      num_envs: environments of each training, stepped side by side.
      trainings: trainings, spread over the cores.
      data_devices: devices that share the environments of a training.

    Raises:
      UsageError: a file of the user's has computed already, and the run needs more threads than JAX
        then started.
    """
    cores = available_cores()
    shards = num_shards(trainings, max(1, cores // data_devices))
    # More devices than any machine has cores are not made: `make_mesh` refuses them.
    devices = shards * data_devices if data_devices <= MOST_DEVICES else cores
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        with contextlib.suppress(RuntimeError):  # a user without a home keeps nothing
            cache = Path.home() / ".cache" / "hitmdp_jax"
            jax.config.update("jax_compilation_cache_dir", str(cache))
    rows = max(num_envs // data_devices, RESET_CHUNK) * -(-trainings // shards)
    safe = None if physics is None else find_engine(physics).safe_rows
    unsafe = safe is not None and rows > safe
    try:
        jax.config.update("jax_num_cpu_devices", devices)
    except RuntimeError:  # JAX computes already, with what `present_cores` made
        if unsafe:
            raise UsageError(
                f"A file of your own makes JAX arrays when it is imported, which starts JAX; "
                f"{rows:,} simulations of physics={physics} side by side need more threads than it "
                "starts with: make the arrays in the class, or with NumPy."
            ) from None
        return
    os.environ.setdefault("NPROC", str(THREADS_PER_CORE * cores if unsafe else devices))
