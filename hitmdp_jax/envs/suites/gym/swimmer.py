"""Swimmer: a planar three-link swimmer in a viscous fluid (Coulom 2002), as in Gymnasium."""

import dataclasses

from hitmdp_jax.envs.base import SolverBudget
from hitmdp_jax.envs.suites.base import VERSIONS
from hitmdp_jax.envs.suites.gym.runner import Runner


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class Swimmer(Runner):
    """Swim to the right: reward is velocity along x (m/s) less a control cost.

    Observation [8]: angle of the front link and of the two joints (rad), then the five generalised
    velocities. Action [2]: torques on the joints in [-1, 1]. There is no termination; the time
    limit is 1000 steps of 0.04 s. Versions v4 and v5 define the same task.

    Args:
      physics: the engine; see `MujocoEnv`.
      version: "v5" or "v4", Gymnasium's semantics of that name.
      forward_reward_weight: weight of the velocity along x.
      ctrl_cost_weight: weight of the squared action.
      reset_noise_scale: half-width of the uniform noise on qpos and qvel.
      exclude_current_positions_from_observation: leave the tip's x and y out of the observation.
      hide_velocities: leave the velocities out of the observation [3].
    """

    model_files = dict.fromkeys(VERSIONS, "swimmer.xml")
    frame_skip = 4  # substeps of 0.01 s, RK4
    # One control step errs by 2.3e-7 in qpos with 2 and 2 iterations as with 100 and 50, by 5e-3
    # with 1 and 2. One iteration is to spare.
    mjx_budget = SolverBudget(iterations=3, ls_iterations=2)
    places = 2  # x and y of the front tip, m

    ctrl_cost_weight: float = 1e-4
