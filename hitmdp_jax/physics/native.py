"""MuJoCo C on a thread pool, called from inside compiled JAX programs."""

import dataclasses
import functools
import hashlib
import threading
from collections.abc import Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from hitmdp_jax.checks import whole_number
from hitmdp_jax.machine import available_cores
from hitmdp_jax.physics import host_call
from hitmdp_jax.physics.base import Engine, PhysicsState, beyond_limits, blank_state
from hitmdp_jax.precision import in_32_bits

# Warnings with which MuJoCo says that it found a state unstable.
_UNSTABLE = [
    int(warning)
    for warning in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
]
# What `Batch.step` computes at the new state: nothing, or what depends on position and velocity.
_LAGGING, _CURRENT = mujoco.mjtStage.mjSTAGE_NONE, mujoco.mjtStage.mjSTAGE_VEL
# Fields that only mj_rnePostConstraint computes.
_POST_CONSTRAINT = ("cfrc_ext", "cfrc_int", "cacc")


@dataclasses.dataclass(frozen=True)
class NativeEngine(Engine):
    """MuJoCo C itself, on the CPU.

    Args:
      num_threads: threads of one call; 0 takes every core that the process may use.

    Raises:
      UsageError: num_threads is not a whole number from 0.
    """

    name: ClassVar[str] = "native"

    num_threads: int = 0

    def __post_init__(self):
        whole_number("num_threads", self.num_threads, at_least=0)

    def build(
        self,
        model: mujoco.MjModel,
        frame_skip: int,
        fields: Sequence[str] = (),
        current_fields: bool = False,
    ) -> "NativePhysics":
        """Build the physics of one model, which MuJoCo C runs as it is."""
        return NativePhysics(model, frame_skip, fields, current_fields, self.num_threads)

    def shared(self, num_devices: int) -> "NativeEngine":
        """Return the engine with its share of the threads, at least one, for each device."""
        threads = self.num_threads or available_cores()
        return dataclasses.replace(self, num_threads=max(1, threads // num_devices))


class NativePhysics:
    """Implements `Physics` with `mujoco.batch.Batch`, called from inside the program (`host_call`).

    The simulations' state lives in JAX arrays alone; the host holds no state between calls, so
    programs that step it stay pure, can be saved exactly and map over seeds and environments: every
    `vmap` around it ends up in one call on the host. Inputs and outputs each cross as one matrix,
    because every further array costs tens of microseconds.

    Args:
      model: the compiled model.
      frame_skip: substeps in one control step.
      fields: names of the derived MjData fields the task reads.
      current_fields: compute those of position and velocity once more after the last substep, at
        the new state.
      num_threads: threads of one call; 0 takes every core that the process may use. Give each XLA
        device its share.
    """

    name = "native"

    def __init__(
        self,
        model: mujoco.MjModel,
        frame_skip: int,
        fields: Sequence[str] = (),
        current_fields: bool = False,
        num_threads: int = 0,
    ):
        self.model = model
        self.frame_skip = frame_skip
        # MuJoCo's own 0 takes every core of the machine, allowed to the process or not.
        self.num_threads = num_threads or available_cores()
        self._fields = tuple(fields)
        self._current_fields = current_fields
        blank = mujoco.MjData(model)
        self._field_shapes = {f: np.shape(getattr(blank, f)) for f in self._fields}
        self._idle: dict[int, list[_Pool]] = {}
        self._lock = threading.Lock()
        # Programs are kept in the compilation cache: the names must tell models apart.
        settings = (frame_skip, self._fields, current_fields, self.num_threads)
        content = _bytes_of(model) + repr(settings).encode()
        self._key = f"hitmdp_jax.native.{hashlib.sha256(content).hexdigest()}"
        self._functions = {w: functools.partial(self._on_host, w) for w in ("forward", "step")}
        for what, function in self._functions.items():
            host_call.register(f"{self._key}.{what}", function)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle what it is made from: a pool of threads stays with its process."""
        settings = self.frame_skip, self._fields, self._current_fields, self.num_threads
        return NativePhysics, (self.model, *settings)

    def initial(self, qpos: jax.Array, qvel: jax.Array) -> PhysicsState:
        """Return the state at `qpos` [nq], `qvel` [nv] with derived fields computed there."""
        state = blank_state(self.model, qpos, qvel)
        return self._call("forward", state) if self._fields else state

    def step(self, state: PhysicsState, ctrl: jax.Array) -> PhysicsState:
        """Advance `frame_skip` substeps under the constant control `ctrl` [nu]."""
        return self._call("step", in_32_bits(state.replace(ctrl=ctrl)))

    def _call(self, what: str, state: PhysicsState) -> PhysicsState:
        nq, nv = self.model.nq, self.model.nv
        sizes = [nq, nv, nv, nq, 1, *(int(np.prod(s)) for s in self._field_shapes.values())]
        packed = jnp.concatenate([state.qpos, state.qvel, state.qacc_warmstart, state.ctrl])
        out = host_call.call(f"{self._key}.{what}", packed, sum(sizes), self._functions[what])
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
        return state.replace(unstable=(parts[4][0] > 0) | beyond_limits(state))

    def _on_host(self, what: str, rows: np.ndarray, out: np.ndarray) -> None:
        pool = self._borrow(len(rows))
        try:
            pool.run(what, rows, out)
        finally:
            self._give_back(pool)

    def _borrow(self, num_rows: int) -> "_Pool":
        """Take an idle pool of this size: devices that step at the same time get one each."""
        with self._lock:
            idle = self._idle.setdefault(num_rows, [])
            if idle:
                return idle.pop()
        return _Pool(
            self.model,
            self.frame_skip,
            self._fields,
            self._current_fields,
            num_rows,
            self.num_threads,
        )

    def _give_back(self, pool: "_Pool") -> None:
        with self._lock:
            self._idle[pool.num_rows].append(pool)


def _bytes_of(model: mujoco.MjModel) -> bytes:
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


class _Pool:
    """A `Batch` of a fixed number of simulations with its bound arrays. Host only; no JAX."""

    def __init__(
        self,
        model: mujoco.MjModel,
        frame_skip: int,
        fields: Sequence[str],
        current_fields: bool,
        num_rows: int,
        num_threads: int,
    ):
        self.num_rows = num_rows
        self._frame_skip = frame_skip
        self._stage_after = _CURRENT if current_fields else _LAGGING
        self._forces = {
            field: np.zeros((num_rows, model.nbody, 6))
            for field in fields
            if field in _POST_CONSTRAINT
        }
        self._scratch = mujoco.MjData(model)
        # Views: looking the attributes up for every simulation would cost as much as the forces.
        self._scratch_forces = [(to, getattr(self._scratch, f)) for f, to in self._forces.items()]
        # A persistent batch keeps every simulation's contacts, which the external forces need.
        self._batch = Batch(model, num_rows, nthread=num_threads, persistent=bool(self._forces))
        self._inputs = [self._batch.bind(f) for f in ("qpos", "qvel", "qacc_warmstart", "ctrl")]
        self._outputs = [
            self._forces[f] if f in self._forces else self._batch.bind(f) for f in fields
        ]

    def run(self, what: str, rows: np.ndarray, out: np.ndarray) -> None:
        """Run "step" or "forward" from packed states into the packed result."""
        column = 0
        for bound in self._inputs:
            bound[:] = rows[:, column : column + bound.shape[1]]
            column += bound.shape[1]
        qpos, qvel, warmstart, _ = self._inputs
        before = qpos.copy()
        self._batch.warning[:] = 0
        failed: np.ndarray | list[int] = []
        try:
            if what == "step":
                self._batch.step(nstep=self._frame_skip, stage=self._stage_after)
            else:
                self._batch.forward()
        except SimulationError as error:  # the other simulations ran to completion
            failed = error.ids
        # MuJoCo resets an unstable state and goes on: its warning is the only trace.
        unstable = self._batch.warning[:, _UNSTABLE, 1].any(axis=1)
        unstable[failed] = True
        if what == "step":
            self._update_forces()
        else:
            for force in self._forces.values():
                force[:] = 0.0
        # The displacement is taken in float64: a velocity is a small difference of positions.
        outputs = [qpos, qvel, warmstart, qpos - before, unstable[:, None]]
        outputs += [output.reshape(self.num_rows, -1) for output in self._outputs]
        np.concatenate(outputs, axis=1, out=out, casting="same_kind")

    def _update_forces(self) -> None:
        """Run mj_rnePostConstraint on each simulation as the last substep left it.

        A sensor that makes mj_step do so would show the contacts at the start of the substep:
        RK4's later stages evaluate no sensors. The copy and the call take 8 us a simulation,
        against 75 us and more for the step of a model with contacts.
        """
        if not self._forces:
            return
        batch, scratch, model = self._batch, self._scratch, self._batch.model
        for row in range(self.num_rows):
            batch.get_data(row, scratch)
            mujoco.mj_rnePostConstraint(model, scratch)
            for force, computed in self._scratch_forces:
                force[row] = computed
