"""Fish: a swimmer of seven joints in space, as in DeepMind Control; upright and upside down."""

import jax
import jax.numpy as jnp
import mujoco

from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.envs.suites.dmc.rewards import tolerance
from hitmdp_jax.envs.suites.dmc.suite import load_suite_model
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FRAME_SKIP = 10  # substeps of 0.004 s
# qpos: position of the torso (m), its orientation as a unit quaternion, and seven angles (rad).
ORIENTATION, ANGLES = slice(3, 7), slice(7, 14)
INITIAL_ANGLE = 0.2  # rad, half-width


def _without_contacts(spec: mujoco.MjSpec) -> None:
    """Take the geoms out of collision detection.

    The model's constraints are switched off, so contacts are neither found nor felt: with and
    without this edit, 10,000 substeps of MuJoCo C agree to the last bit. MJX wants a test of every
    pair of geoms all the same, and has none of an ellipsoid (tail) against a box (torso).
    """
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0


class FishUpright(MujocoEnv):
    """Turn upright: reward is 10^-(1 - u)², with u the cosine of the torso's tilt.

    Observation [21]: angles of tail (bend, twist, second bend), right fin (roll, pitch) and left
    fin (roll, pitch) (rad); u; the generalised velocities: of the torso along the world's axes
    (m/s) and about its own (rad/s), then of the angles (rad/s). Action [5]: positions that tail,
    tail twist, flapping of both fins, left and right pitch are drawn to (rad), in [-1, 1]. An
    episode starts at rest in any orientation with all angles within 0.2 rad. There is no
    termination; the time limit is 1000 steps of 0.04 s.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    reward_terms = ("reward_upright",)
    target = 1.0  # of u

    def __init__(self, physics: PhysicsChoice = "mjx"):
        # Without constraints the solver has nothing to do: there is no budget to choose.
        super().__init__(load_suite_model("fish", _without_contacts), FRAME_SKIP, physics)

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw a uniform orientation and the joints' angles."""
        key_orientation, key_angles = jax.random.split(key)
        quaternion = jax.random.normal(key_orientation, (4,), jnp.float32)
        angles = jax.random.uniform(key_angles, (7,), jnp.float32, -INITIAL_ANGLE, INITIAL_ANGLE)
        qpos = jnp.asarray(self.model.qpos0, jnp.float32)
        qpos = qpos.at[ORIENTATION].set(quaternion / jnp.linalg.norm(quaternion))
        return qpos.at[ANGLES].set(angles), jnp.zeros(self.model.nv)

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return angles, uprightness and velocities."""
        return jnp.concatenate([data.qpos[ANGLES], self._upright(data)[None], data.qvel])

    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, dict[str, jax.Array]]:
        """Return how near the torso's tilt is to its target."""
        upright = tolerance(self._upright(after), bounds=(self.target, self.target), margin=1.0)
        return upright, {"reward_upright": upright}

    def _upright(self, data: PhysicsState) -> jax.Array:
        """Return u: the z of the torso's z axis in the world."""
        _, x, y, _ = data.qpos[ORIENTATION]
        return 1 - 2 * (x**2 + y**2)


class FishDownleft(FishUpright):
    """Turn upside down: `FishUpright` with reward 10^-(1 + u)². Left, in the name, means nothing.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    target = -1.0
