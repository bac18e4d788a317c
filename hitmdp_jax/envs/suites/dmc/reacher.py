"""Reacher: bring the finger of a planar two-joint arm into a target, as in DeepMind Control."""

import math

import jax
import jax.numpy as jnp
import mujoco

from hitmdp_jax.envs.base import MujocoEnv, Parts, SolverBudget
from hitmdp_jax.envs.suites.dmc.rewards import tolerance
from hitmdp_jax.envs.suites.dmc.suite import load_suite_model, random_joint_angles
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FRAME_SKIP = 1  # substep of 0.02 s
NUM_JOINTS = 2  # of the arm: qpos[:2], qvel[:2]; the target's x and y (m) follow
ARM_LENGTHS = (0.12, 0.12)  # m: shoulder to wrist, wrist to the centre of the finger
FINGER_RADIUS = 0.01  # m
BIG_TARGET, SMALL_TARGET = 0.05, 0.015  # radius, m
TARGET_DISTANCE = (0.05, 0.2)  # from the shoulder, m

# One control step errs by 3.7e-7 in qpos with 2 and 2 iterations as with 100 and 50, by 2e-2 with 1
# and 2 where the wrist hits its stop, the one constraint. One iteration is to spare.
MJX_BUDGET = SolverBudget(iterations=3, ls_iterations=2)


def _target_on_slides(spec: mujoco.MjSpec) -> None:
    """Let the target lie where the state says.

    DeepMind Control writes the episode's target into the model, which environments share here. On
    two slides it is part of the state instead (and in every picture): without contacts in this
    model it moves nothing, and nothing moves it.
    """
    geom = spec.geom("target")
    body = spec.worldbody.add_body(name="target", pos=geom.pos)
    body.add_geom(name="target_", type=geom.type, size=geom.size, material=geom.material)
    spec.delete(geom)
    for name, axis in (("target_x", (1, 0, 0)), ("target_y", (0, 1, 0))):
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)


class ReacherEasy(MujocoEnv):
    """Reach the target: reward is 1 while the finger touches it, else 0.

    Finger and target, of radius 0.05 m, touch when their centres are at most the sum of their radii
    apart. Observation [6]: angles of shoulder and wrist (rad, not wrapped), the vector from finger
    to target (x and y, m), the joints' velocities (rad/s). Action [2]: torques on the joints in
    units of 0.05 N m, in [-1, 1]. An episode starts at rest with the joints anywhere in their
    ranges and a new target, its distance and direction from the shoulder both uniform. There is no
    termination; the time limit is 1000 steps of 0.02 s.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    reward_terms = ("reward_reach",)
    target_radius = BIG_TARGET

    def __init__(self, physics: PhysicsChoice = "mjx"):
        model = load_suite_model("reacher", _target_on_slides)
        model.geom("target_").size[0] = self.target_radius
        super().__init__(model, FRAME_SKIP, physics, mjx_budget=MJX_BUDGET)

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw the arm's angles and the target's place."""
        key_arm, key_radius, key_angle = jax.random.split(key, 3)
        near, far = TARGET_DISTANCE
        radius = jax.random.uniform(key_radius, (), jnp.float32, minval=near, maxval=far)
        angle = jax.random.uniform(key_angle, (), jnp.float32, maxval=2 * math.pi)
        target = radius * jnp.stack([jnp.sin(angle), jnp.cos(angle)])
        arm = random_joint_angles(self.model, key_arm)[:NUM_JOINTS]
        return jnp.concatenate([arm, target]), jnp.zeros(self.model.nv)

    @property
    def parts(self) -> Parts:
        """The way to the target."""
        return {"goal": (2, 3)}

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return the arm's angles, the way to the target and the arm's velocities."""
        return jnp.concatenate(
            [data.qpos[:NUM_JOINTS], self._to_target(data), data.qvel[:NUM_JOINTS]]
        )

    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, dict[str, jax.Array]]:
        """Return 1 if finger and target touch."""
        distance = jnp.linalg.norm(self._to_target(after))
        reach = tolerance(distance, (0.0, self.target_radius + FINGER_RADIUS))
        return reach, {"reward_reach": reach}

    def _to_target(self, data: PhysicsState) -> jax.Array:
        """Return the vector [2] from the centre of the finger to that of the target, m."""
        shoulder, wrist, *target = data.qpos
        upper, lower = ARM_LENGTHS
        finger_x = upper * jnp.cos(shoulder) + lower * jnp.cos(shoulder + wrist)
        finger_y = upper * jnp.sin(shoulder) + lower * jnp.sin(shoulder + wrist)
        return jnp.stack(target) - jnp.stack([finger_x, finger_y])


class ReacherHard(ReacherEasy):
    """Reach the target: `ReacherEasy` with a target of radius 0.015 m.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    target_radius = SMALL_TARGET
