"""HalfCheetah: a planar two-legged runner (Wawrzynski 2009), as Gymnasium defines it."""

import dataclasses

import jax

from hitmdp_jax.envs.base import SolverBudget
from hitmdp_jax.envs.suites.base import VERSIONS
from hitmdp_jax.envs.suites.gym.initial import normal_velocity_around_rest
from hitmdp_jax.envs.suites.gym.runner import Runner


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
    """

    model_files = dict.fromkeys(VERSIONS, "half_cheetah.xml")
    frame_skip = 5  # substeps of 0.01 s
    # One control step errs by 4.7e-6 in qpos with 3 and 2 iterations as with 100 and 50, by 0.3
    # with 2 and 2. One iteration is to spare: from a poor warm start 3 err by 3e-3.
    mjx_budget = SolverBudget(iterations=4, ls_iterations=2, contacts=8)

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw qpos uniformly and qvel normally around the standing pose."""
        return normal_velocity_around_rest(self.model, key, self.reset_noise_scale)
