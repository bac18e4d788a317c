"""Several processes that train one run together: what each does alone, and what all do at once.

Every process runs the same program on its own devices. The first one (process 0) alone writes; what
depends on a clock, a signal or a file is decided by one and told to all, since each computation
across processes waits for everyone.
"""

import atexit
import contextlib
import json
import os
import subprocess
import sys
import traceback
import zlib
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from hitmdp_jax.errors import UsageError, out_of_domain, warn
from hitmdp_jax.runs.interrupt import StopRequest

ADDRESS = "JAX_COORDINATOR_ADDRESS"
NUMBERS = {"num_processes": "JAX_NUM_PROCESSES", "process_id": "JAX_PROCESS_ID"}
# Seconds without a sign of life after which a process counts as gone. Most are missed at once,
# when a computation with them fails.
HEARTBEAT = 60
LONGEST = 2**14  # bytes that one process tells the others
LOST = 1  # the exit code where another process has gone
ENDED = (
    "error: This process of several ended before its time, because it was killed or another one "
    "has gone: resume= with the run folder goes on from the last checkpoint."
)


def join() -> None:
    """Make this process one of those that train together; nothing may have been computed yet.

    How many there are and where the first one listens is read from Slurm's or Open MPI's variables
    or those of a TPU, as `jax.distributed.initialize` does, or from JAX_COORDINATOR_ADDRESS,
    JAX_NUM_PROCESSES and JAX_PROCESS_ID.

    Raises:
      UsageError: they are not there, or are wrong.
    """
    numbers = {}
    for name, variable in NUMBERS.items():
        if text := os.environ.get(variable):
            if not text.isdecimal():
                raise out_of_domain(variable, text, "a whole number from 0")
            numbers[name] = int(text)
    address = os.environ.get(ADDRESS)
    if address is not None and not address.rpartition(":")[2].isdecimal():
        raise out_of_domain(ADDRESS, address, "a host and a port, such as 10.0.0.1:1234")
    # On CPUs, where JAX returns before a computation has ended, one process may take the numbers of
    # one computation for those of another (Gloo: "received data size doesn't match").
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    try:
        _speak_at_an_early_end()
        jax.distributed.initialize(**numbers, heartbeat_timeout_seconds=HEARTBEAT)
    except ValueError as error:
        raise UsageError(
            f"distributed=true finds no other processes ({str(error).rstrip('.')}): start it by "
            f"srun or mpirun, or set {ADDRESS}, {' and '.join(NUMBERS.values())}."
        ) from None


def _speak_at_an_early_end() -> None:
    """Have a shell say in a sentence that this process ended before its time, whatever ended it.

    Where another process has gone, `jax.distributed` may abort this one before Python hears of it.
    """
    command = f"read -r finished || echo '{ENDED}' >&2"
    shell = subprocess.Popen(["sh", "-c", command], stdin=subprocess.PIPE, start_new_session=True)

    def finished() -> None:
        with contextlib.suppress(OSError):
            shell.communicate(b"finished\n")

    atexit.register(finished)  # before that of jax.distributed, which may abort and so comes first


def several() -> bool:
    """Return whether this process trains together with others."""
    return jax.distributed.is_initialized() and jax.process_count() > 1


def is_first() -> bool:
    """Return whether this process is the one that writes: the only one, or process 0."""
    return not several() or jax.process_index() == 0


def told(function: Callable[[], Any]) -> Any:
    """Return in every process what the function returns in the first one, the only one to call it.

    Args:
      function: its result must be JSON's where there are several processes.

    Raises:
      UsageError: the function raised it. In the other processes, which need not repeat the
        sentence, SystemExit with the same exit code.
    """
    if not several():
        return function()
    answer: dict[str, Any] = {}
    if is_first():
        try:
            answer["result"] = function()
        except UsageError as error:
            answer["error"] = str(error)
    text = json.dumps(answer).encode()[:LONGEST].ljust(LONGEST)
    answer = json.loads(bytes(broadcast(np.frombuffer(text, np.uint8))))
    if "error" not in answer:
        return answer["result"]
    if is_first():
        raise UsageError(answer["error"])
    sys.exit(2)


def broadcast(tree: Any) -> Any:
    """Return in every process the first one's arrays; those of the others have their shapes."""
    return multihost_utils.broadcast_one_to_all(tree)


def check_same(what: str, text: str) -> None:
    """Check that all processes were given the same text.

    Raises:
      UsageError: they were not, which would have them wait for one another for ever.
    """
    if several():
        sums = multihost_utils.process_allgather(np.uint32(zlib.crc32(text.encode())))
        if len(set(sums.tolist())) > 1:
            raise UsageError(f"The processes were given different {what}: give all the same.")


def gathered(tree: Any, mesh: Mesh) -> Any:
    """Return arrays that are spread over processes whole, in each of them."""
    if not several():
        return tree
    whole = jax.jit(_identity, out_shardings=NamedSharding(mesh, P()))(tree)
    return jax.tree.map(lambda x: x.addressable_data(0), whole)


def _identity(tree: Any) -> Any:
    return tree


class Agreement:
    """What all processes do after the same iteration, for a signal or the clock of one of them.

    Args:
      stop: the signals that this process hears.
      due: whether this process, if it is the first, should save.
      mesh: of all processes' devices.

    Attributes:
      save: whether all save now.
    """

    def __init__(self, stop: StopRequest, due: Callable[[], bool], mesh: Mesh):
        self._stop, self._due = stop, due
        self._everyone = Mesh(mesh.devices.ravel(), ("everyone",))
        self._asked: jax.Array | None = None
        self._signum: int | None = None
        self.save = False

    @property
    def signum(self) -> int | None:
        """The signal for which all stop, if any."""
        return self._signum if several() else self._stop.signum

    def ask(self) -> None:
        """Ask all processes, once an iteration; they answer when the iteration before is done.

        So the device need not wait for the host, nor a process for another one.
        """
        if not several():
            self.save = self._due()
            return
        mine = np.array([[self._stop.signum or 0, self._due()]], np.int32)
        shape, split = (self._everyone.size, 2), NamedSharding(self._everyone, P("everyone"))
        votes = jax.make_array_from_callback(shape, split, lambda _: mine)
        before = self._asked
        self._asked = jax.jit(_most, out_shardings=NamedSharding(self._everyone, P()))(votes)
        if before is not None:
            signum, self.save = (int(x) for x in np.asarray(before))
            self._signum = signum or None


def _most(votes: jax.Array) -> jax.Array:
    return jnp.max(votes, axis=0)


@contextlib.contextmanager
def ending_together() -> Iterator[None]:
    """End this process at once when it fails, or fails because another one has gone.

    Left to itself it would wait at its exit for those that wait for it.
    """
    try:
        yield
    except Exception as error:
        if not several() or isinstance(error, UsageError):
            raise
        if isinstance(error, jax.errors.JaxRuntimeError):
            reason = (str(error).strip().splitlines() or ["no reason given"])[0]
            warn(f"computing with other processes failed: {reason}")
        else:
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(LOST)
