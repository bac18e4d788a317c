"""`HumanoidBody`: what is observed of the body that Humanoid and HumanoidStandup share."""

import dataclasses

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.base import Parts
from hitmdp_jax.envs.suites.gym.initial import uniform_around_rest
from hitmdp_jax.envs.suites.gym.task import GymTask
from hitmdp_jax.physics import PhysicsState

FRAME_SKIP = 5  # substeps of 0.003 s, RK4
ROOT_Z = 2  # qpos: height of the torso, m; x and y come before it, its quaternion after it
NUM_ROOT_VELOCITIES = 6  # qvel: the torso's three velocities and three angular velocities


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class HumanoidBody(GymTask):
    """A humanoid that feels its body. By default it observes 348 quantities in v5 and 376 in v4.

    Args:
      physics: the engine; see `MujocoEnv`. MJX solves contacts by Newton, MuJoCo C by PGS.
      version: "v5", or "v4", which also observes the world's (zero) inertia, velocity and forces
        and the (zero) actuator forces on the torso.
      ctrl_cost_weight: weight of the squared action.
      reset_noise_scale: half-width of the uniform noise on qpos and qvel.
      exclude_current_positions_from_observation: leave the torso's x and y out of the observation.
      include_cinert_in_observation: observe each body's inertia and mass about the centre of mass
        of the tree, kg m^2, kg m, kg.
      include_cvel_in_observation: observe each body's velocity about that centre, rad/s and m/s.
      include_qfrc_actuator_in_observation: observe the actuator torques, N m.
      include_cfrc_ext_in_observation: observe external torque and force on each body, N m and N.
    """

    ctrl_cost_weight: float = 0.1
    reset_noise_scale: float = 1e-2
    exclude_current_positions_from_observation: bool = True
    include_cinert_in_observation: bool = True
    include_cvel_in_observation: bool = True
    include_qfrc_actuator_in_observation: bool = True
    include_cfrc_ext_in_observation: bool = True

    @property
    def observed_fields(self) -> tuple[str, ...]:
        """Names of the derived MjData fields that are observed."""
        names = ("cinert", "cvel", "qfrc_actuator", "cfrc_ext")
        return tuple(name for name in names if getattr(self, f"include_{name}_in_observation"))

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw qpos and qvel uniformly around the model's pose at rest."""
        return uniform_around_rest(self.model, key, self.reset_noise_scale)

    @property
    def parts(self) -> Parts:
        """The torso's x and y, where they are observed."""
        return {"place": slice(0 if self.exclude_current_positions_from_observation else 2)}

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return positions, velocities and the chosen fields."""
        first_position = 2 if self.exclude_current_positions_from_observation else 0
        parts = [data.qpos[first_position:], data.qvel]
        for name in self.observed_fields:
            first = NUM_ROOT_VELOCITIES if name == "qfrc_actuator" else 1
            parts.append(data[name][0 if self.version == "v4" else first :].ravel())
        return jnp.concatenate(parts)
