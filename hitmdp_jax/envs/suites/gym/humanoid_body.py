"""What Humanoid and HumanoidStandup share: what is observed of the body."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from hitmdp_jax.physics import PhysicsState

ROOT_Z = 2  # qpos: height of the torso, m; x and y come before it, its quaternion after it
NUM_ROOT_VELOCITIES = 6  # qvel: the torso's three velocities and three angular velocities


class HumanoidSenses(NamedTuple):
    """What a humanoid observes. By default 348 quantities in v5 and 376 in v4.

    Attributes:
      version: "v5", or "v4", which also observes the world's (zero) inertia, velocity and forces
        and the (zero) actuator forces on the torso.
      positions: whether to observe the torso's x and y, m.
      cinert: each body's inertia and mass about the centre of mass of the tree, kg m^2, kg m, kg.
      cvel: each body's velocity about that centre, rad/s and m/s.
      qfrc_actuator: actuator forces, N m.
      cfrc_ext: external torque and force on each body, N m and N.
    """

    version: str
    positions: bool
    cinert: bool
    cvel: bool
    qfrc_actuator: bool
    cfrc_ext: bool

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the derived MjData fields that are observed."""
        names = ("cinert", "cvel", "qfrc_actuator", "cfrc_ext")
        return tuple(name for name in names if getattr(self, name))

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return positions, velocities and the chosen fields."""
        parts = [data.qpos if self.positions else data.qpos[2:], data.qvel]
        for name in self.fields:
            first = NUM_ROOT_VELOCITIES if name == "qfrc_actuator" else 1
            parts.append(data[name][0 if self.version == "v4" else first :].ravel())
        return jnp.concatenate(parts)
