"""`GymTask`: a task whose keywords are the fields of a dataclass."""

import dataclasses

from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.physics import PhysicsChoice


@dataclasses.dataclass(eq=False, repr=False)
class GymTask(MujocoEnv):
    """A task of Gymnasium's in its two versions; a subclass adds its keywords as fields.

    `__post_init__(physics)` of the subclass makes the model and calls `MujocoEnv.__init__`,
    which `super()` does not reach.

    Args:
      physics: the engine; see `MujocoEnv`.
      version: "v5" or "v4", Gymnasium's semantics of that name.
    """

    physics: dataclasses.InitVar[PhysicsChoice] = "mjx"  # pyright: ignore
    version: str = "v5"
