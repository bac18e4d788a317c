"""MuJoCo XLA: physics as a JAX program, for any device."""

import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx

from hitmdp_jax.envs.assets import CONTACTS
from hitmdp_jax.physics.base import (
    Engine,
    PhysicsState,
    SolverBudget,
    beyond_limits,
    blank_state,
)
from hitmdp_jax.precision import in_32_bits

# MJX leaves the precision of most products to the device, of which NVIDIA's round both factors to
# ten bits: three steps of HalfCheetah were off by 1.5e-3 of their velocities, and are by 7e-6.
full_precision = jax.default_matmul_precision("highest")


@dataclasses.dataclass(frozen=True)
class MjxEngine(Engine):
    """MJX on XLA.

    Args:
      full_budget: keep the model's own solver iterations, whatever the task's budget.
    """

    name: ClassVar[str] = "mjx"
    # Of the solver's Cholesky factorisations, XLA's threads wait for one another beyond this.
    safe_rows: ClassVar[int | None] = 64

    full_budget: bool = False

    def prepare(self, model: mujoco.MjModel, budget: SolverBudget | None = None) -> None:
        """Choose Newton where the model names PGS, which MJX lacks; set the task's budget.

        One with contacts needs a model of `load_model`, which leaves room for their number.
        """
        newton_for_pgs(model)
        if budget is not None and not self.full_budget:
            model.opt.iterations, model.opt.ls_iterations = budget.iterations, budget.ls_iterations
            if budget.contacts is not None:
                model.numeric(CONTACTS).data[:] = budget.contacts

    def build(
        self,
        model: mujoco.MjModel,
        frame_skip: int,
        fields: Sequence[str] = (),
        current_fields: bool = False,
    ) -> "MjxPhysics":
        """Build the physics of one prepared model."""
        return MjxPhysics(model, frame_skip, fields, current_fields)


class MjxPhysics:
    """Implements `Physics` with MJX.

    Only the generalised state crosses a control step; everything else in `mjx.Data` is recomputed
    from it, so a thousand environments cost kilobytes, not gigabytes.

    Args:
      model: the compiled model; its solver options are the budget MJX works with.
      frame_skip: substeps in one control step.
      fields: names of the derived MjData fields the task reads.
      current_fields: compute them once more after the last substep, at the new state.
    """

    name = "mjx"
    implementation: ClassVar[str] = "jax"  # MJX's word for what computes

    def __init__(
        self,
        model: mujoco.MjModel,
        frame_skip: int,
        fields: Sequence[str] = (),
        current_fields: bool = False,
    ):
        self.model = model
        self.frame_skip = frame_skip
        self._fields = tuple(fields)
        self._current_fields = current_fields
        blank = mujoco.MjData(model)
        self._field_shapes = {f: np.shape(getattr(blank, f)) for f in self._fields}
        self._mjx_model = mjx.put_model(model, impl=self.implementation)
        self._blank = mjx.make_data(model, impl=self.implementation)

    def initial(self, qpos: jax.Array, qvel: jax.Array) -> PhysicsState:
        """Return the state at `qpos` [nq], `qvel` [nv] with derived fields computed there."""
        state = blank_state(self.model, qpos, qvel)
        return self._forward(self._blank, state) if self._fields else state

    def step(self, state: PhysicsState, ctrl: jax.Array) -> PhysicsState:
        """Advance `frame_skip` substeps under the constant control `ctrl` [nu]."""
        return self._advance(self._blank, state.replace(ctrl=ctrl))

    @full_precision
    def _forward(self, blank: mjx.Data, state: PhysicsState) -> PhysicsState:
        data = mjx.forward(_without_empty_constants(self._mjx_model), _load(blank, state))
        return in_32_bits(state.replace(derived=self._read(data)))

    @full_precision
    def _advance(self, blank: mjx.Data, state: PhysicsState) -> PhysicsState:
        model = _without_empty_constants(self._mjx_model)

        def substep(carry: PhysicsState, _: None) -> tuple[PhysicsState, None]:
            data = self._substep(model, _load(blank, carry))
            carry = carry.replace(
                qpos=data.qpos,
                qvel=data.qvel,
                qacc_warmstart=data.qacc_warmstart,
                derived=carry.derived if self._current_fields else self._read(data),
            )
            return carry, None

        start = _in_precision_of(blank, state)
        after, _ = jax.lax.scan(substep, start, length=self.frame_skip)
        if self._current_fields:
            # Of this, XLA keeps what leads to the fields: kinematics, not contacts or the solver.
            data = mjx.forward(model, _load(blank, after))
            after = after.replace(derived=self._read(data))
        displacement, unstable = after.qpos - start.qpos, beyond_limits(after)
        return in_32_bits(after.replace(displacement=displacement, unstable=unstable))

    def _substep(self, model: mjx.Model, data: mjx.Data) -> mjx.Data:
        data = mjx.step(model, data)
        if "cfrc_ext" in self._fields:
            # Only the last substep's are read, but all are cheap beside the solver.
            data = mjx.rne_postconstraint(model, data)
        return data

    def _read(self, data: mjx.Data) -> dict[str, jax.Array]:
        # MJX keeps some of MuJoCo's fields among its implementation's own (cinert, cfrc_ext), and
        # shapes rotation matrices [3, 3] where MuJoCo has [9].
        own = data._impl
        return {
            field: getattr(own if hasattr(own, field) else data, field).reshape(shape)
            for field, shape in self._field_shapes.items()
        }


def newton_for_pgs(model: mujoco.MjModel) -> None:
    """Choose Newton, in place, where a model names PGS, which MJX lacks."""
    if model.opt.solver == mujoco.mjtSolver.mjSOL_PGS:
        model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON


def _load(blank: mjx.Data, state: PhysicsState) -> mjx.Data:
    state = _in_precision_of(blank, state)
    return _without_empty_constants(blank).replace(
        qpos=state.qpos,
        qvel=state.qvel,
        ctrl=state.ctrl,
        qacc_warmstart=state.qacc_warmstart,
    )


def _in_precision_of(blank: mjx.Data, state: PhysicsState) -> PhysicsState:
    """Return a state in the floats that MJX computes with, which are JAX's default."""

    def converted(x: jax.Array) -> jax.Array:
        return x.astype(blank.qpos.dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x

    return jax.tree.map(converted, state)


def _without_empty_constants(tree: Any) -> Any:
    """Make the arrays without elements anew in the program that is being traced.

    Where one that it closes over is spread over devices, jaxlib 0.11's compiler crashes.
    """
    return jax.tree.map(lambda x: x if x.size else jnp.zeros(x.shape, x.dtype), tree)
