"""Ant: a four-legged runner (Schulman et al. 2016), as Gymnasium defines it."""

import dataclasses

import jax
import jax.numpy as jnp
import mujoco

from hitmdp_jax.envs.assets import load_gymnasium_model
from hitmdp_jax.envs.base import MujocoEnv, Parts, SolverBudget
from hitmdp_jax.envs.suites.gym.initial import normal_velocity_around_rest
from hitmdp_jax.envs.suites.gym.task import HealthyTask, Terms
from hitmdp_jax.errors import unknown_name
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FRAME_SKIP = 5  # substeps of 0.01 s, RK4
ROOT_Z = 2  # qpos: height of the torso, m; x and y come before it, its quaternion after it
ORIENTATION = slice(3, 7)  # qpos: the torso's unit quaternion

# One control step errs by 1.7e-2 in qpos with 3 and 2 iterations as with 100 and 50, by 6e-2 with 2
# and 2; one iteration is to spare. These errors are no rounding: on a steep capsule MJX lays the
# friction pyramid along the world's axes, MuJoCo C along the capsule's. The median error is 1.3e-5.
MJX_BUDGET = SolverBudget(iterations=4, ls_iterations=2, contacts=8)


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class Ant(HealthyTask):
    """Run along x: reward is forward velocity (m/s), plus 1 for health, less control and contact.

    Observation [105]: torso height (m) and orientation (quaternion), eight joint angles (rad), the
    fourteen generalised velocities, and the external force and torque (N, N m) on each of the
    thirteen bodies, clipped to [-1, 1]. Action [8]: torques on hips and ankles in [-1, 1]. The ant
    is healthy while its height lies inside its range and the state is finite; the episode
    terminates when it is not. The time limit is 1000 steps of 0.05 s.

    Args:
      physics: the engine; see `MujocoEnv`.
      version: "v5", or "v4", which has no contact forces by default [27] and also pays the healthy
        reward for the step that ends the episode.
      forward_reward_weight: weight of the forward velocity.
      ctrl_cost_weight: weight of the squared action.
      contact_cost_weight: weight of the squared, clipped contact forces.
      healthy_reward: reward of a healthy step.
      main_body: the body whose velocity is rewarded, by number or name.
      terminate_when_unhealthy: whether the episode ends there.
      healthy_z_range: closed interval for the torso's height, m.
      contact_force_range: the contact forces are clipped to it.
      reset_noise_scale: half-width of the uniform noise on qpos, std of the normal noise on qvel.
      exclude_current_positions_from_observation: leave the torso's x and y out of the observation.
      use_contact_forces: observe the contact forces and pay for them; None: v5 does, v4 does not.
      include_cfrc_ext_in_observation: whether to observe them; None: as `use_contact_forces`.
    """

    reward_terms = ("reward_forward", "reward_ctrl", "reward_contact", "reward_survive")

    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 0.5
    contact_cost_weight: float = 5e-4
    main_body: int | str = "torso"
    healthy_z_range: tuple[float, float] = (0.2, 1.0)
    contact_force_range: tuple[float, float] = (-1.0, 1.0)
    reset_noise_scale: float = 0.1
    exclude_current_positions_from_observation: bool = True
    use_contact_forces: bool | None = None
    include_cfrc_ext_in_observation: bool | None = None

    def __post_init__(self, physics: PhysicsChoice):
        pays, observes = self.use_contact_forces, self.include_cfrc_ext_in_observation
        pays = self.version == "v5" if pays is None else pays
        observes = pays if observes is None else observes
        model = load_gymnasium_model("ant.xml")
        fields = ("xpos", "cfrc_ext") if pays or observes else ("xpos",)
        MujocoEnv.__init__(self, model, FRAME_SKIP, physics, fields, MJX_BUDGET)
        self._pays_contact_forces = pays
        self._observes_contact_forces = observes
        # v4 observes the world's forces, too, which are zero.
        self._first_observed_body = 0 if self.version == "v4" else 1
        self._main_body = find_body(model, self.main_body)
        self._first_position = 2 if self.exclude_current_positions_from_observation else 0

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw qpos uniformly and qvel normally around the standing pose."""
        return normal_velocity_around_rest(self.model, key, self.reset_noise_scale)

    @property
    def parts(self) -> Parts:
        """The torso's x and y, where they are observed."""
        return {"place": slice(2 - self._first_position)}

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return positions, velocities and, if observed, contact forces."""
        parts = [data.qpos[self._first_position :], data.qvel]
        if self._observes_contact_forces:
            parts.append(self._contact_forces(data)[self._first_observed_body :].ravel())
        return jnp.concatenate(parts)

    def terms(self, before: PhysicsState, after: PhysicsState, action: jax.Array) -> Terms:
        """Return forward velocity, control and contact costs, and the healthy reward."""
        distance = after["xpos"][self._main_body, 0] - before["xpos"][self._main_body, 0]
        forward = self.forward_reward_weight * distance / self.dt
        ctrl = -self.ctrl_cost_weight * jnp.sum(action**2)
        contact = jnp.zeros(())
        if self._pays_contact_forces:
            contact = -self.contact_cost_weight * jnp.sum(self._contact_forces(after) ** 2)
        return {
            "reward_forward": forward,
            "reward_ctrl": ctrl,
            "reward_contact": contact,
            "reward_survive": self.survive_reward(after),
        }

    def healthy(self, data: PhysicsState) -> jax.Array:
        """Return whether the height lies inside its range and the state is finite."""
        low, high = self.healthy_z_range
        z = data.qpos[ROOT_Z]
        finite = jnp.isfinite(data.qpos).all() & jnp.isfinite(data.qvel).all()
        return finite & (low <= z) & (z <= high)

    def _contact_forces(self, data: PhysicsState) -> jax.Array:
        """Return the clipped external torque and force on each body [14, 6], N m and N."""
        return jnp.clip(data["cfrc_ext"], *self.contact_force_range)


def on_its_back(data: PhysicsState) -> jax.Array:
    """Return whether the torso's own upward axis points below the horizon."""
    _, x, y, _ = data.qpos[ORIENTATION]
    return x**2 + y**2 > 0.5


def find_body(model: mujoco.MjModel, body: int | str) -> int:
    """Return the number of a body of a model, given by number or name.

    Raises:
      UsageError: the model has no such body.
    """
    numbers = {model.body(i).name: i for i in range(model.nbody) if model.body(i).name}
    if body in numbers:
        return numbers[body]
    if isinstance(body, int) and 0 <= body < model.nbody:
        return body
    raise unknown_name("main_body", str(body), numbers)
