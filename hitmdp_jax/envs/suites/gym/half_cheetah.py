"""HalfCheetah: a planar two-legged runner (Wawrzynski 2009), as Gymnasium defines it."""

import dataclasses

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.base import Drawn, SolverBudget
from hitmdp_jax.envs.suites.base import VERSIONS
from hitmdp_jax.envs.suites.gym.initial import normal_velocity_around_rest
from hitmdp_jax.envs.suites.gym.runner import Runner
from hitmdp_jax.errors import out_of_domain
from hitmdp_jax.physics import PhysicsChoice


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class HalfCheetah(Runner):
    """Run forward fast: reward is forward velocity (m/s) less a control cost.

    Observation [17]: torso height (m) and pitch (rad), six joint angles (rad), then the nine
    generalised velocities. Action [6]: torques in [-1, 1], back thigh to front foot. There is no
    termination; the time limit is 1000 steps of 0.05 s. Versions v4 and v5 define the same task.

    Args:
      physics: the engine; see `MujocoEnv`.
      version: "v5" or "v4", Gymnasium's semantics of that name.
      forward_reward_weight: weight of the forward velocity.
      ctrl_cost_weight: weight of the squared action.
      reset_noise_scale: half-width of the uniform noise on qpos, std of the normal noise on qvel.
      exclude_current_positions_from_observation: leave the torso's x out of the observation.
      hide_velocities: leave the velocities out of the observation [8].
      friction_range: each episode draws a factor of all sliding friction from it.
      mass_range: each episode draws a factor of all masses from it.
    """

    model_files = dict.fromkeys(VERSIONS, "half_cheetah.xml")
    frame_skip = 5  # substeps of 0.01 s
    # One control step errs by 4.7e-6 in qpos with 3 and 2 iterations as with 100 and 50, by 0.3
    # with 2 and 2. One iteration is to spare: from a poor warm start 3 err by 3e-3.
    mjx_budget = SolverBudget(iterations=4, ls_iterations=2, contacts=8)

    friction_range: tuple[float, float] = (1.0, 1.0)
    mass_range: tuple[float, float] = (1.0, 1.0)

    def __post_init__(self, physics: PhysicsChoice):
        super().__post_init__(physics)
        for name in ("friction_range", "mass_range"):
            if not getattr(self, name)[0] > 0:
                value = list(getattr(self, name))
                raise out_of_domain(name, value, "two numbers above 0, the lower first")

    def sample_model(self, key: jax.Array) -> Drawn:
        """Draw the friction and the masses, where there is a choice."""
        key_friction, key_mass = jax.random.split(key)
        friction = jax.random.uniform(key_friction, (), jnp.float32, *self.friction_range)
        mass = jax.random.uniform(key_mass, (), jnp.float32, *self.mass_range)
        drawn = {}
        if tuple(self.friction_range) != (1.0, 1.0):
            sliding = jnp.stack([friction, jnp.ones(()), jnp.ones(())])  # of three kinds
            drawn["geom_friction"] = sliding * self.model.geom_friction
        if tuple(self.mass_range) != (1.0, 1.0):
            drawn["body_mass"] = mass * self.model.body_mass
            drawn["body_inertia"] = mass * self.model.body_inertia
        return drawn

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw qpos uniformly and qvel normally around the standing pose."""
        return normal_velocity_around_rest(self.model, key, self.reset_noise_scale)
