"""Humanoid: a three-dimensional biped (Tassa, Erez & Todorov 2012), as Gymnasium defines it."""

import dataclasses
import math

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.assets import load_gymnasium_model
from hitmdp_jax.envs.base import MujocoEnv, SolverBudget
from hitmdp_jax.envs.suites.gym.humanoid_body import FRAME_SKIP, ROOT_Z, HumanoidBody
from hitmdp_jax.envs.suites.gym.task import HealthyTask, Terms, within
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

CONTACT_COST_WEIGHT = 5e-7

# One control step errs by 1.1e-5 in qpos with 6 and 4 iterations as with 100 and 50, by 2e-4 with 5
# and 4, by 1e-3 with 100 and 2. One iteration is to spare.
MJX_BUDGET = SolverBudget(iterations=7, ls_iterations=4, contacts=12)


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class Humanoid(HealthyTask, HumanoidBody):
    """Walk along x: reward is the mass centre's velocity (m/s), plus 5 for health, less costs.

    Observation [348]: torso height (m) and orientation (quaternion), seventeen joint angles (rad),
    the 23 generalised velocities, then of each of the thirteen bodies its inertia (10), velocity
    (6) and, after the seventeen actuator torques, external torque and force (6). Action [17]:
    torques in [-0.4, 0.4], abdomen to elbows. The humanoid is healthy while its height lies inside
    its range; the episode terminates when it is not. The time limit is 1000 steps of 0.015 s.

    Args:
      physics: the engine; see `MujocoEnv`. MJX solves contacts by Newton, MuJoCo C by PGS.
      version: "v5", or "v4", which observes constant zeros too [376; see `HumanoidBody`], has no
        contact cost and also pays the healthy reward for the step that ends the episode.
      forward_reward_weight: weight of the forward velocity.
      contact_cost_weight: weight of the squared contact forces; None: 5e-7 in v5, 0 in v4.
      contact_cost_range: the weighted contact cost is clipped to it.
      healthy_reward: reward of a healthy step.
      terminate_when_unhealthy: whether the episode ends there.
      healthy_z_range: open interval for the torso's height, m.
      **keywords: see `HumanoidBody`.
    """

    reward_terms = ("reward_survive", "reward_forward", "reward_ctrl", "reward_contact")

    forward_reward_weight: float = 1.25
    contact_cost_weight: float | None = None
    contact_cost_range: tuple[float, float] = (-math.inf, 10.0)
    healthy_reward: float = 5.0
    healthy_z_range: tuple[float, float] = (1.0, 2.0)

    def __post_init__(self, physics: PhysicsChoice):
        if self.contact_cost_weight is None:
            self.contact_cost_weight = CONTACT_COST_WEIGHT if self.version == "v5" else 0.0
        fields = {"xipos", *self.observed_fields}
        if self.contact_cost_weight:
            fields.add("cfrc_ext")
        model = load_gymnasium_model("humanoid.xml")
        MujocoEnv.__init__(self, model, FRAME_SKIP, physics, sorted(fields), MJX_BUDGET)

    def terms(self, before: PhysicsState, after: PhysicsState, action: jax.Array) -> Terms:
        """Return forward velocity, control and contact costs, and the healthy reward."""
        distance = self._mass_centre_x(after) - self._mass_centre_x(before)
        forward = self.forward_reward_weight * distance / self.dt
        ctrl = -self.ctrl_cost_weight * jnp.sum(action**2)
        contact = jnp.zeros(())
        if self.contact_cost_weight:
            cost = self.contact_cost_weight * jnp.sum(after["cfrc_ext"] ** 2)
            contact = -jnp.clip(cost, *self.contact_cost_range)
        return {
            "reward_forward": forward,
            "reward_ctrl": ctrl,
            "reward_contact": contact,
            "reward_survive": self.survive_reward(after),
        }

    def healthy(self, data: PhysicsState) -> jax.Array:
        """Return whether the height lies inside its range."""
        return within(data.qpos[ROOT_Z], self.healthy_z_range)

    def _mass_centre_x(self, data: PhysicsState) -> jax.Array:
        """Return the x of the whole body's centre of mass, m."""
        shares = self.model.body_mass / self.model.body_mass.sum()
        # Not a dot product, which accelerators round to fewer digits than a velocity needs.
        return jnp.sum(shares * data["xipos"][:, 0])
