"""What a task asks of a physics engine, and the state it gets back."""

from typing import Protocol

import jax
import jax.numpy as jnp
import mujoco
from flax import struct

# MuJoCo calls a simulation unstable when a coordinate, velocity or acceleration exceeds this.
MAX_VALUE = float(mujoco.mjMAXVAL)


class PhysicsState(struct.PyTreeNode):
    """Generalised state of one simulation, plus the derived fields its task reads.

    Angles are in rad, positions in m, velocities per second. Derived fields (`state["xpos"]`) are
    one substep behind `qpos` after a step, as in MuJoCo's own `mj_step` (with RK4: at its last
    stage), unless the engine was built with `current_fields`. External forces (`cfrc_ext`) are
    those of `mj_rnePostConstraint` on the same data, and zero before the first step: what Gymnasium
    shows.
    """

    qpos: jax.Array  # [nq] generalised positions
    qvel: jax.Array  # [nv] generalised velocities
    ctrl: jax.Array  # [nu] the controls of the last step
    qacc_warmstart: jax.Array  # [nv] where the constraint solver starts
    displacement: jax.Array  # [nq] change of qpos over the last step, at the engine's own precision
    unstable: jax.Array  # bool: MuJoCo's limits on the state were broken in the last step
    derived: dict[str, jax.Array]  # MjData field name -> its value

    def __getitem__(self, field: str) -> jax.Array:
        """Return a derived MjData field by name."""
        return self.derived[field]


def blank_state(model: mujoco.MjModel, qpos: jax.Array, qvel: jax.Array) -> PhysicsState:
    """Return the state at `qpos` [nq], `qvel` [nv] without derived fields."""
    return PhysicsState(
        qpos=jnp.asarray(qpos, jnp.float32),
        qvel=jnp.asarray(qvel, jnp.float32),
        ctrl=jnp.zeros(model.nu),
        qacc_warmstart=jnp.zeros(model.nv),
        displacement=jnp.zeros(model.nq),
        unstable=jnp.zeros((), bool),
        derived={},
    )


def beyond_limits(state: PhysicsState) -> jax.Array:
    """Return whether MuJoCo would call the state unstable, acceleration included."""
    values = jnp.concatenate([state.qpos, state.qvel, state.qacc_warmstart])
    return ~(jnp.abs(values) < MAX_VALUE).all()  # so written that NaN is beyond them, too


class Physics(Protocol):
    """A physics engine for one model: pure functions that jit and vmap.

    Attributes:
      name: the engine, as the user names it.
      model: the compiled MuJoCo model.
      frame_skip: physics substeps in one control step.
    """

    name: str
    model: mujoco.MjModel
    frame_skip: int

    def initial(self, qpos: jax.Array, qvel: jax.Array) -> PhysicsState:
        """Return the state at `qpos` [nq], `qvel` [nv] with derived fields computed there."""
        ...

    def step(self, state: PhysicsState, ctrl: jax.Array) -> PhysicsState:
        """Advance `frame_skip` substeps under the constant control `ctrl` [nu]."""
        ...
