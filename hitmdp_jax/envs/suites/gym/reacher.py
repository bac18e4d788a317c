"""Reacher: bring the tip of a planar two-joint arm to a target, as Gymnasium defines it."""

import dataclasses
import math

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.assets import load_gymnasium_model
from hitmdp_jax.envs.base import MujocoEnv, Parts, SolverBudget
from hitmdp_jax.envs.suites.gym.task import GymTask, Terms
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FRAME_SKIP = 2  # substeps of 0.01 s, RK4
NUM_JOINTS = 2  # of the arm: qpos[:2], qvel[:2]; the target's x and y (m) follow
INITIAL_ANGLE = 0.1  # rad, half-width around the stretched arm
INITIAL_VELOCITY = 0.005  # rad/s, half-width
TARGET_RADIUS = 0.2  # m: the targets fill a disc

# One control step errs by 3.7e-6 in qpos with 2 and 2 iterations as with 100 and 50, by 3e-2 with 1
# and 2. One iteration is to spare.
MJX_BUDGET = SolverBudget(iterations=3, ls_iterations=2)


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class Reacher(GymTask):
    """Reach the target: reward is minus the distance (m) to it less a control cost.

    Observation [10]: cosines and sines of the two joint angles, the target's x and y (m), the
    joints' velocities (rad/s), and the vector from target to fingertip (x and y, m). Action [2]:
    torques on the joints in [-1, 1]. There is no termination; the time limit is 50 steps of 0.02 s.

    Args:
      physics: the engine; see `MujocoEnv`.
      version: "v5", or "v4", which observes the vector's z too [11] and rewards the distance before
        the step, not after it.
      reward_dist_weight: weight of the distance.
      reward_control_weight: weight of the squared action.
    """

    episode_length = 50
    reward_terms = ("reward_dist", "reward_ctrl")

    reward_dist_weight: float = 1.0
    reward_control_weight: float = 1.0

    def __post_init__(self, physics: PhysicsChoice):
        model = load_gymnasium_model("reacher.xml")
        MujocoEnv.__init__(
            self, model, FRAME_SKIP, physics, fields=("xpos",), mjx_budget=MJX_BUDGET
        )
        self._fingertip = model.body("fingertip").id
        self._target = model.body("target").id

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw the arm uniformly around its stretched pose and the target uniformly in a disc."""
        key_arm, key_velocity, key_radius, key_angle = jax.random.split(key, 4)
        # A uniform point of a disc directly, where Gymnasium rejects points of the square.
        radius = TARGET_RADIUS * jnp.sqrt(jax.random.uniform(key_radius, (), jnp.float32))
        angle = jax.random.uniform(key_angle, (), jnp.float32, maxval=2 * math.pi)
        target = radius * jnp.array([jnp.cos(angle), jnp.sin(angle)])
        noise = jax.random.uniform(key_arm, (NUM_JOINTS,), jnp.float32, -1.0, 1.0)
        arm = self.model.qpos0[:NUM_JOINTS] + INITIAL_ANGLE * noise
        noise = jax.random.uniform(key_velocity, (NUM_JOINTS,), jnp.float32, -1.0, 1.0)
        velocity = jnp.concatenate([INITIAL_VELOCITY * noise, jnp.zeros(2)])
        return jnp.concatenate([arm, target]), velocity

    @property
    def parts(self) -> Parts:
        """The target, and the way from it to the fingertip."""
        return {"goal": (4, 5, 8, 9, 10) if self.version == "v4" else (4, 5, 8, 9)}

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return the arm, the target and the vector between them."""
        angles, target = data.qpos[:NUM_JOINTS], data.qpos[NUM_JOINTS:]
        vector = self._from_target(data)
        return jnp.concatenate(
            [
                jnp.cos(angles),
                jnp.sin(angles),
                target,
                data.qvel[:NUM_JOINTS],
                vector if self.version == "v4" else vector[:2],
            ]
        )

    def terms(self, before: PhysicsState, after: PhysicsState, action: jax.Array) -> Terms:
        """Return minus the distance, and the control cost."""
        vector = self._from_target(before if self.version == "v4" else after)
        distance = -self.reward_dist_weight * jnp.linalg.norm(vector)
        ctrl = -self.reward_control_weight * jnp.sum(action**2)
        return {"reward_dist": distance, "reward_ctrl": ctrl}

    def _from_target(self, data: PhysicsState) -> jax.Array:
        """Return the vector [3] from the target to the fingertip, m."""
        return data["xpos"][self._fingertip] - data["xpos"][self._target]
