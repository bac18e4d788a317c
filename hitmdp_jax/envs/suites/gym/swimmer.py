"""Swimmer: a planar three-link swimmer in a viscous fluid (Coulom 2002), as in Gymnasium."""

import dataclasses

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.assets import load_gymnasium_model
from hitmdp_jax.envs.base import MujocoEnv, SolverBudget
from hitmdp_jax.envs.suites.gym.initial import uniform_around_rest
from hitmdp_jax.envs.suites.gym.task import GymTask
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FRAME_SKIP = 4  # substeps of 0.01 s, RK4
ROOT_X = 0  # qpos: x of the front tip, m; y follows

# One control step errs by 2.3e-7 in qpos with 2 and 2 iterations as with 100 and 50, by 5e-3 with 1
# and 2. One iteration is to spare.
MJX_BUDGET = SolverBudget(iterations=3, ls_iterations=2)


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class Swimmer(GymTask):
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

    reward_terms = ("reward_forward", "reward_ctrl")

    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 1e-4
    reset_noise_scale: float = 0.1
    exclude_current_positions_from_observation: bool = True
    hide_velocities: bool = False

    def __post_init__(self, physics: PhysicsChoice):
        model = load_gymnasium_model("swimmer.xml")
        MujocoEnv.__init__(self, model, FRAME_SKIP, physics, mjx_budget=MJX_BUDGET)
        self._first_position = 2 if self.exclude_current_positions_from_observation else 0
        self._observed_velocities = 0 if self.hide_velocities else model.nv

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw qpos and qvel uniformly around the stretched pose."""
        return uniform_around_rest(self.model, key, self.reset_noise_scale)

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return positions and velocities."""
        velocity = data.qvel[: self._observed_velocities]
        return jnp.concatenate([data.qpos[self._first_position :], velocity])

    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, dict[str, jax.Array]]:
        """Return velocity along x less control cost, both weighted."""
        forward = self.forward_reward_weight * after.displacement[ROOT_X] / self.dt
        ctrl = -self.ctrl_cost_weight * jnp.sum(action**2)
        return forward + ctrl, {"reward_forward": forward, "reward_ctrl": ctrl}
