"""A ball in mazes: PointMaze of D4RL (Fu et al. 2020), as Gymnasium-Robotics v3 defines it."""

import dataclasses

import jax
import jax.numpy as jnp
from brax.envs.base import State

from hitmdp_jax.envs.assets import load_model
from hitmdp_jax.envs.base import MujocoEnv, Parts, SolverBudget
from hitmdp_jax.envs.suites.maze.maps import FOUR_ROOMS, MEDIUM_MAZE, U_MAZE, Maze
from hitmdp_jax.envs.suites.maze.maze import MazeEnv
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FRAME_SKIP = 1  # substep of 0.01 s
CELL, HEIGHT = 1.0, 0.4  # m
MAX_SPEED = 5.0  # m/s along x and along y, at the start of a step
NUM_JOINTS = 2  # of the ball: qpos[:2], qvel[:2]

# In Gymnasium-Robotics the ball's radius is 0.1 m and contacts begin 4 mm before surfaces meet. MJX
# finds none there; with a radius 4 mm larger and no margin the motion is the same in every engine.
# The ball moves in the plane, so that the floor is there to be seen only. Of the walls it can touch
# those around one corner of its cell: MJX looks at the nearest and no further.
BALL = """
<mujoco model="point">
  <compiler angle="radian" inertiafromgeom="true"/>
  <option timestep="0.01" gravity="0 0 0" iterations="20" integrator="Euler"/>
  <custom><numeric name="max_geom_pairs" data="4"/></custom>
  <default>
    <geom condim="1"/>
  </default>
  <asset>
    <texture name="floor" type="2d" builtin="checker" rgb1="0.2 0.3 0.4" rgb2="0.1 0.2 0.3"
      width="100" height="100"/>
    <material name="floor" texture="floor" texrepeat="20 20"/>
  </asset>
  <worldbody>
    <light directional="true" pos="0 0 10" dir="0 0 -1"/>
    <geom type="plane" size="20 20 1" pos="0 0 -0.1" material="floor" contype="0" conaffinity="0"/>
    <body name="ball">
      <joint name="ball_x" type="slide" axis="1 0 0" damping="1"/>
      <joint name="ball_y" type="slide" axis="0 1 0" damping="1"/>
      <geom type="sphere" size="0.104" mass="4.18879" rgba="0.3 0.6 0.3 1"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor_x" joint="ball_x" gear="100" ctrlrange="-1 1" ctrllimited="true"/>
    <motor name="motor_y" joint="ball_y" gear="100" ctrlrange="-1 1" ctrllimited="true"/>
  </actuator>
</mujoco>
"""

# One control step errs by 1.4e-7 in qpos with 3 and 2 iterations as with 100 and 50, by 1.7e-4 with
# 2 and 2. One iteration is to spare.
MJX_BUDGET = SolverBudget(iterations=4, ls_iterations=2)


@dataclasses.dataclass(eq=False, repr=False)
class PointMaze(MazeEnv):
    """Push a ball through a maze of cells 1 m wide to the goal.

    Observation [8]: x and y of the ball (m), its velocity along both (m/s), then x and y once more
    and the goal's: see `MazeEnv`. Action [2]: force along x and y in units of 100 N, in [-1, 1], on
    4.2 kg. Velocities are clipped to 5 m/s before every step of 0.01 s. An episode starts at rest.

    Args:
      **keywords: see `MazeEnv`.
    """

    def __post_init__(self, physics: PhysicsChoice):
        model = load_model(BALL, self.maze.add_to)
        MujocoEnv.__init__(self, model, FRAME_SKIP, physics, mjx_budget=MJX_BUDGET)

    def step(self, state: State, action: jax.Array) -> State:
        """Clip the velocities and advance one control step."""
        data = state.pipeline_state
        assert isinstance(data, PhysicsState)
        data = data.replace(qvel=jnp.clip(data.qvel, -MAX_SPEED, MAX_SPEED))
        slowed = state.replace(pipeline_state=data)  # pyright: ignore[reportAttributeAccessIssue]
        return super().step(slowed, action)

    @property
    def parts(self) -> Parts:
        """The ball's place, which is shown twice, and the goal; its velocity is the body."""
        return {**super().parts, "place": (0, 1, 4, 5)}

    def proprioception(self, data: PhysicsState) -> jax.Array:
        """Return the ball's place and velocity."""
        return jnp.concatenate([data.qpos[:NUM_JOINTS], data.qvel[:NUM_JOINTS]])


class PointUMaze(PointMaze):
    """`PointMaze` around one corner after the other. The time limit is 300 steps."""

    maze = Maze(U_MAZE, CELL, HEIGHT)
    episode_length = 300


class PointMediumMaze(PointMaze):
    """`PointMaze` in a maze of 26 cells with a loop. The time limit is 600 steps."""

    maze = Maze(MEDIUM_MAZE, CELL, HEIGHT)
    episode_length = 600


class PointFourRooms(PointMaze):
    """`PointMaze` in four rooms with a hallway between neighbours. The time limit is 800 steps."""

    maze = Maze(FOUR_ROOMS, CELL, HEIGHT)
    episode_length = 800
