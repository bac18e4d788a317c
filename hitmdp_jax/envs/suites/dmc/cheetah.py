"""Cheetah: a planar runner (Wawrzyński 2009), as in DeepMind Control; and running backward."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from mujoco.batch import Batch

from hitmdp_jax.envs.base import MujocoEnv, SolverBudget
from hitmdp_jax.envs.suites.dmc.rewards import tolerance
from hitmdp_jax.envs.suites.dmc.suite import load_suite_model, random_joint_angles, sensor_slice
from hitmdp_jax.machine import available_cores
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FRAME_SKIP = 1  # substep of 0.01 s
TARGET_SPEED = 10.0  # m/s: full reward from here
SETTLING_STEPS = 200  # substeps without control before an episode
NUM_SETTLED = 1024  # initial states to draw from

# One control step errs by 3.0e-7 in qpos with 5 and 2 iterations as with 100 and 50, by 1.5e-4 with
# 4 and 2. One iteration is to spare: random actions do not visit every state, and a converged
# solver does not use it.
MJX_BUDGET = SolverBudget(iterations=6, ls_iterations=2, contacts=8)


class CheetahRun(MujocoEnv):
    """Run forward: reward is the speed (m/s) of the mass centre as a share of 10, in [0, 1].

    Observation [17]: height (m) and pitch (rad) of the torso, six joint angles (rad), and the nine
    generalised velocities (m/s, rad/s). Action [6]: torques on the joints in units of 120, 90, 60,
    90, 60 and 30 N m, in [-1, 1]. There is no termination; the time limit is 1000 steps of 0.01 s.

    An episode starts where the cheetah lies or stands 2 s after a fall from 0.7 m with random joint
    angles. Those 200 substeps would cost a fifth of an episode, and far more where fresh states are
    kept in stock. So `NUM_SETTLED` falls are simulated once a process, by MuJoCo C, and an episode
    starts from one of them: an independent sample of DeepMind Control's distribution, the same
    states for every engine and run.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    reward_terms = ("reward_run",)
    direction = 1.0  # of the speed that is rewarded, along x

    def __init__(self, physics: PhysicsChoice = "mjx"):
        super().__init__(
            load_suite_model("cheetah"),
            FRAME_SKIP,
            physics,
            fields=("sensordata",),
            mjx_budget=MJX_BUDGET,
            current_fields=True,
        )
        self._velocity = sensor_slice(self.model, "torso_subtreelinvel")

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw one of the settled states."""
        qpos, qvel = settled_states(NUM_SETTLED)
        index = jax.random.randint(key, (), 0, NUM_SETTLED, jnp.int32)
        return jnp.asarray(qpos)[index], jnp.asarray(qvel)[index]

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return positions, without the torso's x, and velocities."""
        return jnp.concatenate([data.qpos[1:], data.qvel])

    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, dict[str, jax.Array]]:
        """Return the share of the target speed."""
        velocity = after["sensordata"][self._velocity]
        run = tolerance(
            self.direction * velocity[0],
            bounds=(TARGET_SPEED, math.inf),
            margin=TARGET_SPEED,
            value_at_margin=0.0,
            sigmoid="linear",
        )
        return run, {"reward_run": run}


class CheetahBackward(CheetahRun):
    """Run backward: `CheetahRun` with the speed along -x rewarded.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    direction = -1.0


@functools.cache
def settled_states(num_states: int) -> tuple[np.ndarray, np.ndarray]:
    """Return qpos [N, nq] and qvel [N, nv] of N falls from random joint angles."""
    model = load_suite_model("cheetah")
    # A first use may be inside a trace, which these constants are no part of.
    with jax.ensure_compile_time_eval():
        keys = jax.random.split(jax.random.key(0), num_states)
        qpos = jax.vmap(lambda key: random_joint_angles(model, key, turn_unlimited=False))(keys)
    batch = Batch(model, num_states, nthread=available_cores())
    final_qpos, final_qvel = batch.bind("qpos"), batch.bind("qvel")
    final_qpos[:] = qpos
    batch.step(nstep=SETTLING_STEPS)
    return final_qpos.astype(np.float32), final_qvel.astype(np.float32)
