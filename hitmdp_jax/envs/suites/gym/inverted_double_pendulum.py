"""InvertedDoublePendulum: balance two linked poles on a cart, as Gymnasium defines it."""

import dataclasses

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.assets import load_gymnasium_model
from hitmdp_jax.envs.base import MujocoEnv, Parts, SolverBudget
from hitmdp_jax.envs.suites.gym.initial import normal_velocity_around_rest
from hitmdp_jax.envs.suites.gym.task import GymTask, Terms
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FRAME_SKIP = 5  # substeps of 0.01 s, RK4
CART = 0  # qpos, qvel: position of the cart (m); the two joint angles (rad) follow
TARGET_HEIGHT = 2.0  # m, where the penalty puts the tip; the poles' full length is 1.2 m
MIN_HEIGHT = 1.0  # m, of the tip
MAX_OBSERVED = 10.0  # m/s, rad/s, N

# One control step errs by 6.6e-6 in qpos with 2 and 2 iterations as with 100 and 50, by 4e-2 with 1
# and 2. One iteration is to spare.
MJX_BUDGET = SolverBudget(iterations=3, ls_iterations=2)


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class InvertedDoublePendulum(GymTask):
    """Balance both poles: reward 10 a step less penalties on the tip's position and the velocities.

    Observation [9]: cart position (m), sines and cosines of the two joint angles, the three
    generalised velocities and the constraint force on the cart (N), both clipped to [-10, 10].
    Action [1]: force on the cart in [-1, 1]. The episode terminates when the tip sinks to 1 m; the
    time limit is 1000 steps of 0.05 s.

    Args:
      physics: the engine; see `MujocoEnv`.
      version: "v5", or "v4", which observes all three constraint forces [11] and also pays the
        healthy reward for the step that ends the episode.
      healthy_reward: reward of a step with the tip up.
      reset_noise_scale: half-width of the uniform noise on qpos, std of the normal noise on qvel.
    """

    reward_terms = ("reward_survive", "distance_penalty", "velocity_penalty")

    healthy_reward: float = 10.0
    reset_noise_scale: float = 0.1

    def __post_init__(self, physics: PhysicsChoice):
        model = load_gymnasium_model("inverted_double_pendulum.xml")
        fields = ("site_xpos", "qfrc_constraint")
        MujocoEnv.__init__(self, model, FRAME_SKIP, physics, fields, MJX_BUDGET)
        self._reward_at_end = self.healthy_reward if self.version == "v4" else 0.0
        self._observed_forces = model.nv if self.version == "v4" else 1
        self._tip = model.site("tip").id

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw qpos uniformly and qvel normally around the upright rest."""
        return normal_velocity_around_rest(self.model, key, self.reset_noise_scale)

    @property
    def parts(self) -> Parts:
        """The cart's position."""
        return {"place": (0,)}

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return cart, poles, velocities and constraint forces."""
        cart, angles = data.qpos[: CART + 1], data.qpos[CART + 1 :]
        force = data["qfrc_constraint"][: self._observed_forces]
        return jnp.concatenate(
            [
                cart,
                jnp.sin(angles),
                jnp.cos(angles),
                jnp.clip(data.qvel, -MAX_OBSERVED, MAX_OBSERVED),
                jnp.clip(force, -MAX_OBSERVED, MAX_OBSERVED),
            ]
        )

    def terms(self, before: PhysicsState, after: PhysicsState, action: jax.Array) -> Terms:
        """Return the healthy reward and the penalties."""
        x, _, z = after["site_xpos"][self._tip]
        distance = -(0.01 * x**2 + (z - TARGET_HEIGHT) ** 2)
        _, lower, upper = after.qvel
        velocity = -(1e-3 * lower**2 + 5e-3 * upper**2)
        survive = jnp.where(self.terminated(after), self._reward_at_end, self.healthy_reward)
        return {
            "reward_survive": survive,
            "distance_penalty": distance,
            "velocity_penalty": velocity,
        }

    def terminated(self, data: PhysicsState) -> jax.Array:
        """Return whether the tip sank too low."""
        return data["site_xpos"][self._tip, 2] <= MIN_HEIGHT
