"""Hopper: a planar one-legged hopper (Erez, Tassa & Todorov 2011), as Gymnasium defines it."""

import dataclasses
import math

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.base import SolverBudget
from hitmdp_jax.envs.suites.base import VERSIONS
from hitmdp_jax.envs.suites.gym.runner import HealthyRunner
from hitmdp_jax.envs.suites.gym.task import within
from hitmdp_jax.physics import PhysicsState

ROOT_Z, ROOT_PITCH = 1, 2  # qpos: height (m), angle (rad)


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class Hopper(HealthyRunner):
    """Hop forward: reward is forward velocity (m/s) plus 1 for being healthy less a control cost.

    Observation [11]: torso height (m) and pitch (rad), three joint angles (rad), then the six
    generalised velocities clipped to [-10, 10]. Action [3]: torques on thigh, leg and foot in
    [-1, 1]. The hopper is healthy while its height, pitch and every other coordinate and velocity
    lie inside their ranges; the episode terminates when it is not. The time limit is 1000 steps of
    0.008 s.

    Args:
      physics: the engine; see `MujocoEnv`.
      version: "v5", or "v4", which also pays the healthy reward for the step that ends the episode.
      forward_reward_weight: weight of the forward velocity.
      ctrl_cost_weight: weight of the squared action.
      healthy_reward: reward of a healthy step.
      terminate_when_unhealthy: whether the episode ends there.
      healthy_state_range: open interval for qpos[2:] and qvel.
      healthy_z_range: open interval for the torso's height, m.
      healthy_angle_range: open interval for the torso's pitch, rad.
      reset_noise_scale: half-width of the uniform noise on qpos and qvel.
      exclude_current_positions_from_observation: leave the torso's x out of the observation.
      hide_velocities: leave the velocities out of the observation [5].
    """

    model_files = dict.fromkeys(VERSIONS, "hopper.xml")
    frame_skip = 4  # substeps of 0.002 s, RK4
    # One control step errs by 6.5e-7 in qpos with 3 and 2 iterations as with 100 and 50, by 3e-4
    # with 2 and 2. One iteration is to spare: random actions do not visit every state, and a
    # converged solver does not use it.
    mjx_budget = SolverBudget(iterations=4, ls_iterations=2)

    healthy_state_range: tuple[float, float] = (-100.0, 100.0)
    healthy_z_range: tuple[float, float] = (0.7, math.inf)
    healthy_angle_range: tuple[float, float] = (-0.2, 0.2)

    def healthy(self, data: PhysicsState) -> jax.Array:
        """Return whether height, pitch and the remaining state lie inside their ranges."""
        rest = jnp.concatenate([data.qpos[ROOT_PITCH:], data.qvel])
        return (
            within(rest, self.healthy_state_range)
            & within(data.qpos[ROOT_Z], self.healthy_z_range)
            & within(data.qpos[ROOT_PITCH], self.healthy_angle_range)
        )
