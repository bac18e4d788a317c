"""Physics engines behind one protocol: MJX (XLA), MuJoCo C, and MJX on Warp."""

from collections.abc import Callable, Sequence

import mujoco

from hitmdp_jax.envs.physics.base import Physics, PhysicsState
from hitmdp_jax.errors import UsageError, unknown_name

ENGINES = ("mjx", "native", "warp")

__all__ = ["ENGINES", "Physics", "PhysicsChoice", "PhysicsState", "make_physics"]


PhysicsChoice = str | Callable[[mujoco.MjModel, int, Sequence[str], bool], Physics]


def make_physics(
    engine: PhysicsChoice,
    model: mujoco.MjModel,
    frame_skip: int,
    fields: Sequence[str] = (),
    current_fields: bool = False,
) -> Physics:
    """Build the engine of that name for a model.

    Args:
      engine: "mjx", "native" or "warp"; or a constructor with the four arguments that follow.
      model: the compiled MuJoCo model.
      frame_skip: substeps in one control step.
      fields: names of the derived MjData fields the task reads.
      current_fields: bring the fields of position and velocity up to date after a step.

    Raises:
      UsageError: there is no engine of that name, its extra is missing, or the model has actuator
        activations, which neither engine carries.
    """
    if not isinstance(engine, str):
        return engine(model, frame_skip, fields, current_fields)
    if engine not in ENGINES:
        raise unknown_name("physics", engine, ENGINES)
    if model.na:
        raise UsageError("Models with actuator activations (na > 0) are not supported.")
    if engine == "native":
        from hitmdp_jax.envs.physics.native import NativePhysics

        return NativePhysics(model, frame_skip, fields, current_fields)
    from hitmdp_jax.envs.physics.mjx import MjxPhysics

    implementation = "warp" if engine == "warp" else "jax"
    return MjxPhysics(model, frame_skip, fields, current_fields, implementation)
