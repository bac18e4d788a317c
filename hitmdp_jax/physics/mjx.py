"""MuJoCo XLA: physics as a JAX program, for any device."""

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import mujoco
from mujoco import mjx

from hitmdp_jax.physics.base import (
    CONTACTS,
    DERIVED_FROM,
    Engine,
    Physics,
    PhysicsState,
    SolverBudget,
    beyond_limits,
)
from hitmdp_jax.physics.constants import constants_of
from hitmdp_jax.precision import in_32_bits

# MJX leaves the precision of most products to the device, of which NVIDIA's round both factors to
# ten bits: three steps of HalfCheetah were off by 1.5e-3 of their velocities, and are by 7e-6.
full_precision = jax.default_matmul_precision("highest")


class MjxPhysics(Physics):
    """Implements `Physics` with MJX.

    Only the generalised state crosses a control step; everything else in `mjx.Data` is recomputed
    from it, so a thousand environments cost kilobytes, not gigabytes.
    """

    name = "mjx"
    implementation: ClassVar[str] = "jax"  # MJX's word for what computes

    def __init__(self, *arguments: Any, **keywords: Any):
        super().__init__(*arguments, **keywords)
        self._mjx_model = mjx.put_model(self.model, impl=self.implementation)
        self._blank = mjx.make_data(self.model, impl=self.implementation)

    @full_precision
    def complete(self, drawn: Mapping[str, jax.Array]) -> dict[str, jax.Array]:
        """Return drawn fields with what MuJoCo derives from masses."""
        fields = super().complete(drawn)
        if DERIVED_FROM.isdisjoint(fields):
            return fields
        model = _without_empty_constants(self._mjx_model).replace(**fields)
        return fields | in_32_bits(constants_of(self.model, model))

    def step(self, state: PhysicsState, ctrl: jax.Array) -> PhysicsState:
        """Advance `frame_skip` substeps under the constant control `ctrl` [nu]."""
        return self._advance_from(self._blank, state.replace(ctrl=ctrl))

    def _forward(self, state: PhysicsState) -> PhysicsState:
        return self._forward_from(self._blank, state)

    @full_precision
    def _forward_from(self, blank: mjx.Data, state: PhysicsState) -> PhysicsState:
        data = mjx.forward(self._model_of(blank, state), _load(blank, state))
        return in_32_bits(state.replace(derived=self._read(data)))

    @full_precision
    def _advance_from(self, blank: mjx.Data, state: PhysicsState) -> PhysicsState:
        model = self._model_of(blank, state)

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

    def _model_of(self, blank: mjx.Data, state: PhysicsState) -> mjx.Model:
        drawn = _in_precision_of(blank, state).drawn
        return _without_empty_constants(self._mjx_model).replace(**drawn)

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


@dataclasses.dataclass(frozen=True)
class MjxEngine(Engine):
    """MJX on XLA.

    Args:
      full_budget: keep the model's own solver iterations, whatever the task's budget.
    """

    name: ClassVar[str] = "mjx"
    physics: ClassVar[type[Physics]] = MjxPhysics
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
