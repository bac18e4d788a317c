"""MuJoCo C on a thread pool, called from inside compiled JAX programs."""

import dataclasses
import functools
import hashlib
import threading
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from hitmdp_jax.checks import whole_number
from hitmdp_jax.machine import available_cores
from hitmdp_jax.physics import host_call
from hitmdp_jax.physics.base import Engine, Physics, PhysicsState, beyond_limits
from hitmdp_jax.physics.pool import Pool
from hitmdp_jax.precision import in_32_bits


class NativePhysics(Physics):
    """Implements `Physics` with `mujoco.batch.Batch`, called from inside the program (`host_call`).

    The simulations' state lives in JAX arrays alone; the host holds no state between calls, so
    programs that step it stay pure, can be saved exactly and map over seeds and environments: every
    `vmap` around it ends up in one call on the host. Inputs and outputs each cross as one matrix,
    because every further array costs tens of microseconds.

    Args:
      arguments: of `Physics`.
      num_threads: threads of one call; 0 takes every core that the process may use. Give each XLA
        device its share.
      keywords: of `Physics`.
    """

    name = "native"

    def __init__(self, *arguments: Any, num_threads: int = 0, **keywords: Any):
        super().__init__(*arguments, **keywords)
        # MuJoCo's own 0 takes every core of the machine, allowed to the process or not.
        self.num_threads = num_threads or available_cores()
        self._settings = self.frame_skip, self._fields, self._current_fields
        self._idle: dict[tuple[int, tuple[str, ...]], list[Pool]] = {}
        self._lock = threading.Lock()
        # Programs are kept in the compilation cache: the names must tell models apart.
        content = _bytes_of(self.model) + repr((*self._settings, self.num_threads)).encode()
        self._key = f"hitmdp_jax.native.{hashlib.sha256(content).hexdigest()}"
        for what in ("forward", "step"):
            self._registered(what, ())  # before a program from the cache calls it

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle what it is made from: a pool of threads stays with its process."""
        arguments = (self.model, *self._settings)
        return functools.partial(NativePhysics, num_threads=self.num_threads), arguments

    def step(self, state: PhysicsState, ctrl: jax.Array) -> PhysicsState:
        """Advance `frame_skip` substeps under the constant control `ctrl` [nu]."""
        return self._call("step", state.replace(ctrl=ctrl))

    def _forward(self, state: PhysicsState) -> PhysicsState:
        return self._call("forward", state)

    def _call(self, what: str, state: PhysicsState) -> PhysicsState:
        nq, nv = self.model.nq, self.model.nv
        sizes = [nq, nv, nv, nq, 1, *(int(np.prod(s)) for s in self._field_shapes.values())]
        drawn = [jnp.ravel(state.drawn[field]) for field in sorted(state.drawn)]
        packed = [state.qpos, state.qvel, state.qacc_warmstart, state.ctrl, *drawn]
        name, function = self._registered(what, tuple(sorted(state.drawn)))
        out = host_call.call(name, jnp.concatenate(packed), sum(sizes), function)
        parts = jnp.split(out, np.cumsum(sizes)[:-1])
        state = state.replace(
            qpos=parts[0],
            qvel=parts[1],
            qacc_warmstart=parts[2],
            displacement=parts[3],
            derived={
                field: part.reshape(shape)
                for (field, shape), part in zip(self._field_shapes.items(), parts[5:], strict=True)
            },
        )
        # MuJoCo warns of what it finds at the start of a substep; the last one's end is seen here.
        return in_32_bits(state.replace(unstable=(parts[4][0] > 0) | beyond_limits(state)))

    def _registered(self, what: str, drawn: tuple[str, ...]) -> tuple[str, host_call.RowFunction]:
        """Return what programs call "step" or "forward" with those fields drawn, and what it is."""
        name = ".".join([self._key, what, *drawn])
        function = functools.partial(self._on_host, what, drawn)
        host_call.register(name, function)
        return name, function

    def _on_host(
        self, what: str, drawn: tuple[str, ...], rows: np.ndarray, out: np.ndarray
    ) -> None:
        pool = self._borrow(len(rows), drawn)
        try:
            pool.run(what, rows, out)
        finally:
            self._give_back(pool)

    def _borrow(self, num_rows: int, drawn: tuple[str, ...]) -> Pool:
        """Take an idle pool of this size: devices that step at the same time get one each."""
        with self._lock:
            idle = self._idle.setdefault((num_rows, drawn), [])
            if idle:
                return idle.pop()
        return Pool(self.model, *self._settings, num_rows, self.num_threads, drawn)

    def _give_back(self, pool: Pool) -> None:
        with self._lock:
            self._idle[pool.num_rows, pool.drawn].append(pool)


@dataclasses.dataclass(frozen=True)
class NativeEngine(Engine):
    """MuJoCo C itself, on the CPU.

    Args:
      num_threads: threads of one call; 0 takes every core that the process may use.

    Raises:
      UsageError: num_threads is not a whole number from 0.
    """

    name: ClassVar[str] = "native"
    physics: ClassVar[type[Physics]] = NativePhysics

    num_threads: int = 0

    def __post_init__(self):
        whole_number("num_threads", self.num_threads, at_least=0)

    def build(self, *arguments: Any, **keywords: Any) -> Physics:
        """Build the physics of one model; the arguments are those of `Physics`."""
        return super().build(*arguments, num_threads=self.num_threads, **keywords)

    def shared(self, num_devices: int) -> "NativeEngine":
        """Return the engine with its share of the threads, at least one, for each device."""
        threads = self.num_threads or available_cores()
        return dataclasses.replace(self, num_threads=max(1, threads // num_devices))


def _bytes_of(model: mujoco.MjModel) -> bytes:
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()
