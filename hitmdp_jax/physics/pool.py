"""Simulations of MuJoCo C that a pool of threads steps together, on the host."""

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

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
