"""Walker: a planar biped (Lillicrap et al. 2015), as in DeepMind Control; and two more tasks."""

import math

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.base import MujocoEnv, SolverBudget
from hitmdp_jax.envs.suites.dmc.rewards import tolerance
from hitmdp_jax.envs.suites.dmc.suite import load_suite_model, random_joint_angles, sensor_slice
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FRAME_SKIP = 10  # substeps of 0.0025 s
XX, XZ, ZZ = 0, 2, 8  # entries of a rotation matrix, row by row
HEIGHT = 2  # entry of a position
STAND_HEIGHT = 1.2  # m
SQUAT_HEIGHT = 0.6  # m
WALK_SPEED = 1.0  # m/s: full reward from here

# One control step errs by 1.1e-5 in qpos with 8 and 4 iterations as with 100 and 50, by 2e-3 with 6
# and 4, by 0.1 with 8 and 2. One iteration is to spare: random actions do not visit every state,
# and a converged solver does not use it.
MJX_BUDGET = SolverBudget(iterations=9, ls_iterations=4)


class WalkerStand(MujocoEnv):
    """Stand: reward, in [0, 1], is three parts the torso's height and one part its uprightness.

    The height's part is full from 1.2 m and a tenth of it at 0.6 m. Observation [24]: of the torso
    and the six bodies of the legs, the cosine and sine of the angle in the plane of motion; height
    of the torso (m); the nine generalised velocities (m/s, rad/s). Action [6]: torques on hip, knee
    and ankle, right then left, in units of 100, 50 and 20 N m, in [-1, 1]. An episode starts at
    rest with the torso at 1.3 m, turned by any angle, and the joints anywhere in their ranges.
    There is no termination; the time limit is 1000 steps of 0.025 s.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    reward_terms: tuple[str, ...] = ("reward_height", "reward_upright")
    target_height = STAND_HEIGHT  # of the torso, m

    def __init__(self, physics: PhysicsChoice = "mjx"):
        super().__init__(
            load_suite_model("walker"),
            FRAME_SKIP,
            physics,
            fields=("xpos", "xmat", "sensordata"),
            mjx_budget=MJX_BUDGET,
            current_fields=True,
        )
        self._torso = self.model.body("torso").id
        self._velocity = sensor_slice(self.model, "torso_subtreelinvel")

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw the torso's turn and the joints' angles."""
        return random_joint_angles(self.model, key), jnp.zeros(self.model.nv)

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return orientations of all bodies, the torso's height and velocities."""
        orientations = data["xmat"][1:, jnp.array([XX, XZ])].ravel()  # without the world's
        height = data["xpos"][self._torso, HEIGHT]
        return jnp.concatenate([orientations, height[None], data.qvel])

    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, dict[str, jax.Array]]:
        """Return the quality of the stand."""
        height, upright = self._stand_terms(after)
        return height + upright, {"reward_height": height, "reward_upright": upright}

    def _stand_terms(self, data: PhysicsState) -> tuple[jax.Array, jax.Array]:
        """Return the parts of height and uprightness, which add up to at most 1."""
        height = tolerance(
            data["xpos"][self._torso, HEIGHT],
            bounds=(self.target_height, math.inf),
            margin=self.target_height / 2,
        )
        upright = (1 + data["xmat"][self._torso, ZZ]) / 2
        return 3 / 4 * height, 1 / 4 * upright


class WalkerSquat(WalkerStand):
    """Squat: `WalkerStand` with full reward for the height from 0.6 m.

    There is no upper bound, so standing up fully is as good: a relaxed stand.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    target_height = SQUAT_HEIGHT


class WalkerWalk(WalkerStand):
    """Walk forward: reward is the quality of the stand times (1 + 5 share of the speed) / 6.

    The share is the speed of the mass centre over 1 m/s, in [0, 1]. All else is `WalkerStand`.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    reward_terms = (*WalkerStand.reward_terms, "reward_move")
    direction = 1.0  # of the speed that is rewarded, along x

    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, dict[str, jax.Array]]:
        """Return the quality of the stand, weighted by that of the motion."""
        height, upright = self._stand_terms(after)
        speed = self.direction * after["sensordata"][self._velocity][0]
        move = tolerance(
            speed,
            bounds=(WALK_SPEED, math.inf),
            margin=WALK_SPEED / 2,
            value_at_margin=0.5,
            sigmoid="linear",
        )
        move = (1 + 5 * move) / 6
        terms = {"reward_height": height, "reward_upright": upright, "reward_move": move}
        return (height + upright) * move, terms


class WalkerBackward(WalkerWalk):
    """Walk backward: `WalkerWalk` with the speed along -x rewarded.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    direction = -1.0
