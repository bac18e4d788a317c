"""What a task asks of a physics engine, the state it gets back, and what an engine owns."""

import abc
import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct

from hitmdp_jax.errors import UsageError

# MuJoCo calls a simulation unstable when a coordinate, velocity or acceleration exceeds this.
MAX_VALUE = float(mujoco.mjMAXVAL)
# Fields of a model from which `mj_setConst` derives others.
DERIVED_FROM = frozenset(mujoco.MjModel._setconst_inputs)  # pyright: ignore
CONTACTS = "max_contact_points"  # the number in which a model tells MJX how many it may solve for


class SolverBudget(NamedTuple):
    """What MJX's constraint solver may take in a substep.

    MuJoCo C stops when it has converged, and solves for the contacts that there are; a compiled
    loop over many environments pays for every iteration it is allowed, and for every pair of geoms
    that could touch. Each task states the smallest budget whose error after one control step equals
    that of the full one.
    """

    iterations: int
    ls_iterations: int
    contacts: int | None = None  # of each dimension, the deepest; None: of all pairs of geoms


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
    # MjModel field name -> its value in this simulation, where that is not the model's
    drawn: dict[str, jax.Array] = struct.field(default_factory=dict)

    def __getitem__(self, field: str) -> jax.Array:
        """Return a derived MjData field by name."""
        return self.derived[field]


def blank_state(model: mujoco.MjModel, qpos: jax.Array, qvel: jax.Array) -> PhysicsState:
    """Return the state at `qpos` [nq], `qvel` [nv] without derived fields."""
    return PhysicsState(
        qpos=jnp.asarray(qpos, jnp.float32),
        qvel=jnp.asarray(qvel, jnp.float32),
        ctrl=jnp.zeros(model.nu, jnp.float32),
        qacc_warmstart=jnp.zeros(model.nv, jnp.float32),
        displacement=jnp.zeros(model.nq, jnp.float32),
        unstable=jnp.zeros((), bool),
        derived={},
    )


def beyond_limits(state: PhysicsState) -> jax.Array:
    """Return whether MuJoCo would call the state unstable, acceleration included."""
    values = jnp.concatenate([state.qpos, state.qvel, state.qacc_warmstart])
    return ~(jnp.abs(values) < MAX_VALUE).all()  # so written that NaN is beyond them, too


class Physics(abc.ABC):
    """A physics engine for one model: pure functions that jit and vmap.

    Args:
      model: the compiled model, prepared for the engine.
      frame_skip: physics substeps in one control step.
      fields: names of the derived MjData fields the task reads.
      current_fields: compute those of position and velocity once more after the last substep, at
        the new state.

    Attributes:
      name: the engine, as the user names it.
    """

    name: ClassVar[str]

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

    def initial(
        self, qpos: jax.Array, qvel: jax.Array, drawn: Mapping[str, jax.Array] | None = None
    ) -> PhysicsState:
        """Return the state at `qpos` [nq], `qvel` [nv] with derived fields computed there.

        Args:
          qpos: generalised positions.
          qvel: generalised velocities.
          drawn: fields of the model that have other values in this simulation.
        """
        state = blank_state(self.model, qpos, qvel)
        if drawn:
            state = state.replace(drawn=self.complete(drawn))
        return self._forward(state) if self._fields else state

    def complete(self, drawn: Mapping[str, jax.Array]) -> dict[str, jax.Array]:
        """Return drawn fields with what the engine must know besides; nothing by default.

        Raises:
          UsageError: the engine has one model for all simulations.
        """
        return {name: jnp.asarray(x, jnp.float32) for name, x in drawn.items()}

    @abc.abstractmethod
    def step(self, state: PhysicsState, ctrl: jax.Array) -> PhysicsState:
        """Advance `frame_skip` substeps under the constant control `ctrl` [nu]."""

    @abc.abstractmethod
    def _forward(self, state: PhysicsState) -> PhysicsState:
        """Return a state with its derived fields."""


@dataclasses.dataclass(frozen=True)
class Engine:
    """A physics engine: what it can run, what it needs for it, and how it is built.

    An engine is one file with a subclass of this, and its entry in `ENGINES`.

    Attributes:
      name: what the user calls it.
      physics: what it builds.
      safe_rows: environments that one CPU device may step at once without blocking a thread of
        XLA's pool; see `set_up_host`. None: any number.
    """

    name: ClassVar[str]
    physics: ClassVar[type[Physics]]
    safe_rows: ClassVar[int | None] = None

    def check(self) -> None:
        """Check that what the engine needs is installed.

        Raises:
          UsageError: it is not.
        """

    def check_task(self, model: mujoco.MjModel, fields: Sequence[str] = ()) -> None:
        """Check that the engine can run a model and compute the derived fields its task reads.

        Raises:
          UsageError: it cannot. No engine carries actuator activations.
        """
        if model.na:
            raise UsageError("Models with actuator activations (na > 0) are not supported.")

    def prepare(self, model: mujoco.MjModel, budget: SolverBudget | None = None) -> None:
        """Make the changes to a compiled model, in place, that the engine needs; none by default.

        Args:
          model: the compiled model.
          budget: the task's solver iterations, for engines that pay for all they are allowed.
        """

    def build(self, *arguments: Any, **keywords: Any) -> Physics:
        """Build the physics of one prepared model; the arguments are those of `Physics`."""
        return self.physics(*arguments, **keywords)

    def shared(self, num_devices: int) -> "Engine":
        """Return the engine with its share of the cores, for each of so many devices."""
        return self
