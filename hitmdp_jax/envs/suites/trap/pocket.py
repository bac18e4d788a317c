"""Mazes whose straight way to the goal ends in a pocket, for a ball and for an ant."""

import dataclasses

import jax
import jax.numpy as jnp
import mujoco

from hitmdp_jax.envs.assets import load_model
from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.envs.suites.maze import maps
from hitmdp_jax.envs.suites.maze.ant import AntUMaze
from hitmdp_jax.envs.suites.maze.maps import Maze
from hitmdp_jax.envs.suites.maze.maze import GOAL, NOISE, POSITION, MazeEnv, RewardType
from hitmdp_jax.envs.suites.maze.point import BALL, MJX_BUDGET, PointMaze
from hitmdp_jax.envs.suites.trap.ant import TrappedAnt, integrate_by_euler
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FRAME_SKIP = 5  # substeps of 0.01 s of the ball, which moves 0.25 m in a step at most
# In the mazes nothing slows the ball down, so that noise alone drives it far: PPO finds the way
# round. Here it forgets a push within 0.25 s, and the greatest force moves it at 5 m/s.
DAMPING, FORCE = 16.8, 84.0  # N s/m and N; the mass is 4.2 kg
# S is the start, G the goal. The pocket is open towards the start, and the goal lies behind it.
POCKET = (
    "#########",
    "#       #",
    "#   ### #",
    "#     # #",
    "#S    #G#",
    "#     # #",
    "#   ### #",
    "#       #",
    "#########",
)
# The same, about three times as long.
LONG_POCKET = (
    "###########################",
    "#                         #",
    "#   ##################### #",
    "#                       # #",
    "#S                      #G#",
    "#                       # #",
    "#   ##################### #",
    "#                         #",
    "###########################",
)


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class PocketEnv(MazeEnv):
    """A maze of one start and one goal, between which lies a pocket.

    The goal pays as much as the straight way to it is long (m), and ends the episode. "dense"
    rewards also pay how much nearer (m) to the goal a step came. Whoever goes straight earns that
    until the pocket's end, and nothing more. Observation, action and the rest are the maze's.

    Args:
      physics: the engine; see `MujocoEnv`.
      reward_type: "dense" or "sparse".
      continuing_task: go on at the goal to the time limit; else the episode terminates there.
    """

    reward_type: RewardType = "dense"
    continuing_task: bool = False

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Return the robot at rest, somewhere in the start's cell, and the goal."""
        noise = jax.random.uniform(key, (2,), jnp.float32, minval=-NOISE, maxval=NOISE)
        start = jnp.asarray(self.maze.centre(maps.START), jnp.float32) + self.maze.cell * noise
        qpos = jnp.asarray(self.model.qpos0, jnp.float32)
        qpos = (
            qpos.at[POSITION]
            .set(start)
            .at[GOAL]
            .set(jnp.asarray(self.maze.centre(maps.GOAL), jnp.float32))
        )
        return qpos, jnp.zeros(self.model.nv)

    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, dict[str, jax.Array]]:
        """Return the goal's prize and, of dense rewards, the way gained."""
        straight = jnp.linalg.norm(self.maze.centre(maps.GOAL) - self.maze.centre(maps.START))
        reward = straight.astype(jnp.float32) * self._at_goal(after)
        if self.reward_type == "dense":
            reward += self._distance(before) - self._distance(after)
        return reward, {"reward_goal": reward}


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class PointPocket(PocketEnv, PointMaze):
    """Push a ball out of the straight way, around the pocket, to the goal.

    The ball is that of `PointMaze`, with steps of 0.05 s, and slowed down: it forgets a push within
    0.25 s, and moves at 5 m/s under the greatest force, 84 N. The goal is 6 m away, the way round
    is 12 m long, and the time limit is 200 steps.

    Args:
      **keywords: see `PocketEnv`.
    """

    maze = Maze(POCKET, cell=1.0, height=0.4)
    episode_length = 200

    def __post_init__(self, physics: PhysicsChoice):
        model = load_model(BALL, self._edit)
        MujocoEnv.__init__(self, model, FRAME_SKIP, physics, mjx_budget=MJX_BUDGET)

    @classmethod
    def _edit(cls, spec: mujoco.MjSpec) -> None:
        for joint in spec.joints:
            joint.damping[0] = DAMPING
        for actuator in spec.actuators:
            actuator.gear[0] = FORCE
        cls.maze.add_to(spec)


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class PointLongPocket(PointPocket):
    """`PointPocket` three times as long: the goal is 24 m away. The time limit is 600 steps."""

    maze = Maze(LONG_POCKET, cell=1.0, height=0.4)
    episode_length = 600


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class AntPocket(TrappedAnt, PocketEnv, AntUMaze):
    """Walk the ant around the pocket to the goal; cells are 4 m wide.

    The ant is that of `AntUMaze`, but on its back it ends the episode, and its motion is integrated
    by Euler's method (`TrappedAnt`). The goal is 24 m away, the way round is 48 m long, and the
    time limit is 1000 steps of 0.05 s.

    Args:
      **keywords: see `PocketEnv`.
      include_cfrc_ext_in_observation: observe the contact forces.
    """

    maze = Maze(POCKET, cell=4.0, height=2.0)
    episode_length = 1000

    include_cfrc_ext_in_observation: bool = False

    @classmethod
    def _edit(cls, spec: mujoco.MjSpec) -> None:
        super()._edit(spec)
        integrate_by_euler(spec)


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class AntLongPocket(AntPocket):
    """`AntPocket` three times as long: the goal is 96 m away. The time limit is 3000 steps."""

    maze = Maze(LONG_POCKET, cell=4.0, height=2.0)
    episode_length = 3000
