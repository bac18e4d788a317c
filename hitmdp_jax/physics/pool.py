"""Simulations of MuJoCo C that a pool of threads steps together, on the host."""

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from hitmdp_jax.physics.base import DERIVED_FROM

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


class Pool:
    """A `Batch` of a fixed number of simulations with its bound arrays. Host only; no JAX."""

    def __init__(
        self,
        model: mujoco.MjModel,
        frame_skip: int,
        fields: Sequence[str],
        current_fields: bool,
        num_rows: int,
        num_threads: int,
        drawn: tuple[str, ...] = (),
    ):
        self.num_rows = num_rows
        self.drawn = drawn  # fields of the model of which each simulation has its own
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

        self._model = DrawnModel(self._batch, drawn)

    def run(self, what: str, rows: np.ndarray, out: np.ndarray) -> None:
        """Run "step" or "forward" from packed states into the packed result."""
        column = 0
        for bound in self._inputs:
            bound[:] = rows[:, column : column + bound.shape[1]]
            column += bound.shape[1]
        self._model.write(rows[:, column:])
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
        batch, scratch = self._batch, self._scratch
        for row in range(self.num_rows):
            batch.get_data(row, scratch)
            mujoco.mj_rnePostConstraint(self._model.of(row), scratch)
            for force, computed in self._scratch_forces:
                force[row] = computed


class DrawnModel:
    """The fields of the model of which each simulation of a batch has its own.

    Args:
      batch: the simulations.
      fields: the names of the fields, in the order of their columns.
    """

    def __init__(self, batch: Batch, fields: tuple[str, ...]):
        self._batch = batch
        self._fields = [batch.expand(field) for field in fields]
        self._derives = not DERIVED_FROM.isdisjoint(fields)
        self._written: np.ndarray | None = None
        self._scratch = batch.get_model(0) if fields else batch.model

    def write(self, rows: np.ndarray) -> None:
        """Give each simulation its fields [N, F], and what follows from masses where they are new.

        An episode's fields stay the same from step to step.
        """
        if not self._fields:
            return
        new = np.arange(len(rows))
        if self._written is not None:
            new = np.flatnonzero((rows != self._written).any(axis=1))
        if not new.size:
            return
        column = 0
        for field in self._fields:
            size = int(np.prod(field.shape[1:]))
            values = rows[new, column : column + size]
            field[new] = values.reshape(-1, *field.shape[1:])
            column += size
        if self._derives:
            self._batch.set_const(new)
        self._written = rows.copy()

    def of(self, row: int) -> mujoco.MjModel:
        """Return the model of a simulation."""
        return self._batch.get_model(row, self._scratch) if self._fields else self._scratch
