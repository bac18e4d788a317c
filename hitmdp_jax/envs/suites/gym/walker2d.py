"""Walker2d: a planar two-legged walker (Erez, Tassa & Todorov 2011), as Gymnasium defines it."""

import dataclasses

import jax

from hitmdp_jax.envs.base import SolverBudget
from hitmdp_jax.envs.suites.gym.runner import HealthyRunner
from hitmdp_jax.envs.suites.gym.task import within
from hitmdp_jax.physics import PhysicsState

ROOT_Z, ROOT_PITCH = 1, 2  # qpos: height (m), angle (rad)


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class Walker2d(HealthyRunner):
    """Walk forward: reward is forward velocity (m/s) plus 1 for being healthy less a control cost.

    Observation [17]: torso height (m) and pitch (rad), six joint angles (rad), then the nine
    generalised velocities clipped to [-10, 10]. Action [6]: torques on thigh, leg and foot of
    either leg in [-1, 1]. The walker is healthy while its height and pitch lie inside their ranges;
    the episode terminates when it is not. The time limit is 1000 steps of 0.008 s.

    Args:
      physics: the engine; see `MujocoEnv`.
      version: "v5", or "v4", whose right foot has less friction (0.9 for 1.9) and which also pays
        the healthy reward for the step that ends the episode.
      forward_reward_weight: weight of the forward velocity.
      ctrl_cost_weight: weight of the squared action.
      healthy_reward: reward of a healthy step.
      terminate_when_unhealthy: whether the episode ends there.
      healthy_z_range: open interval for the torso's height, m.
      healthy_angle_range: open interval for the torso's pitch, rad.
      reset_noise_scale: half-width of the uniform noise on qpos and qvel.
      exclude_current_positions_from_observation: leave the torso's x out of the observation.
      hide_velocities: leave the velocities out of the observation [8].
    """

    model_files = {"v4": "walker2d.xml", "v5": "walker2d_v5.xml"}  # noqa: RUF012
    frame_skip = 4  # substeps of 0.002 s, RK4
    # One control step errs by 6e-7 in qpos with 5 and 2 iterations as with 100 and 50, by 3e-5 with
    # 4 and 2. One iteration is to spare.
    mjx_budget = SolverBudget(iterations=6, ls_iterations=2)

    healthy_z_range: tuple[float, float] = (0.8, 2.0)
    healthy_angle_range: tuple[float, float] = (-1.0, 1.0)

    def healthy(self, data: PhysicsState) -> jax.Array:
        """Return whether height and pitch lie inside their ranges."""
        in_z = within(data.qpos[ROOT_Z], self.healthy_z_range)
        return in_z & within(data.qpos[ROOT_PITCH], self.healthy_angle_range)
