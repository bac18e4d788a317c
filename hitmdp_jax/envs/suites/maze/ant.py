"""An ant in mazes: AntMaze of D4RL (Fu et al. 2020), as Gymnasium-Robotics v5 defines it."""

import dataclasses

import jax
import jax.numpy as jnp
import mujoco

from hitmdp_jax.envs.assets import load_gymnasium_model
from hitmdp_jax.envs.base import MujocoEnv, SolverBudget
from hitmdp_jax.envs.suites.gym.ant import FRAME_SKIP
from hitmdp_jax.envs.suites.maze.maps import U_MAZE, Maze
from hitmdp_jax.envs.suites.maze.maze import MazeEnv
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

FIRST_POSITION, NUM_POSITIONS, NUM_VELOCITIES = 2, 15, 14  # of the ant, without x and y
BODIES = slice(1, 14)  # of the ant: the world comes before them, the goal after
CONTACT_FORCE_RANGE = (-1.0, 1.0)  # N and N m, to which they are clipped

# One control step errs by 2.3e-5 in qpos with 4 and 2 iterations as with 100 and 50, by 3.2e-5 with
# 3 and 2: medians. At a wall it errs by 1e-2 whatever the budget: MuJoCo C lets contacts begin 2 cm
# before surfaces meet, and MJX finds none of a box there. One iteration is to spare.
MJX_BUDGET = SolverBudget(iterations=5, ls_iterations=2, contacts=24)
# Of all pairs of a wall and one of the ant's 13 geoms, MJX looks at the nearest alone. In 1,200
# states the walls touched were among the nearest 12, and contacts 7 at most.
MJX_PAIRS = 24


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class AntUMaze(MazeEnv):
    """Walk the ant through a U-shaped maze of cells 4 m wide to the goal.

    Observation [109]: the ant's own as in `Ant` [105], without x and y; then x and y of the torso
    and the goal's (m): see `MazeEnv`. Action [8]: torques on hips and ankles in [-1, 1]. Nothing is
    paid for but the goal, and an ant on its back goes on. An episode starts at rest in the standing
    pose, all ants with the same heading. The time limit is 700 steps of 0.05 s.

    Args:
      **keywords: see `MazeEnv`.
      include_cfrc_ext_in_observation: observe the contact forces; without them it is [31].
    """

    maze = Maze(U_MAZE, cell=4.0, height=2.0)
    episode_length = 700

    include_cfrc_ext_in_observation: bool = True

    def __post_init__(self, physics: PhysicsChoice):
        model = load_gymnasium_model("ant.xml", self._edit)
        fields = ("cfrc_ext",) if self.include_cfrc_ext_in_observation else ()
        MujocoEnv.__init__(self, model, FRAME_SKIP, physics, fields, MJX_BUDGET)

    def proprioception(self, data: PhysicsState) -> jax.Array:
        """Return height, orientation, angles, velocities and, if observed, contact forces."""
        parts = [data.qpos[FIRST_POSITION:NUM_POSITIONS], data.qvel[:NUM_VELOCITIES]]
        if self.include_cfrc_ext_in_observation:
            parts.append(jnp.clip(data["cfrc_ext"][BODIES], *CONTACT_FORCE_RANGE).ravel())
        return jnp.concatenate(parts)

    @classmethod
    def _edit(cls, spec: mujoco.MjSpec) -> None:
        cls.maze.add_to(spec)
        spec.delete(spec.numeric("init_qpos"))  # nobody's; MJX reads what follows it as its own
        spec.add_numeric(name="max_geom_pairs", data=[MJX_PAIRS])
