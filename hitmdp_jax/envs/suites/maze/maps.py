"""Maps of mazes, and the walls, goal and camera that they put into a model."""

import dataclasses
import functools
import math

import mujoco
import numpy as np

WALL = "#"
START, GOAL = "S", "G"  # marks of maps that fix both
FREE = " " + START + GOAL
CAMERA_ANGLE = 45.0  # degrees, the vertical field of view

# Of D4RL (Fu et al. 2020), as Gymnasium-Robotics has them.
U_MAZE = (
    "#####",
    "#   #",
    "### #",
    "#   #",
    "#####",
)
MEDIUM_MAZE = (
    "########",
    "#  ##  #",
    "#  #   #",
    "##   ###",
    "#  #   #",
    "# #  # #",
    "#   #  #",
    "########",
)
# After Sutton, Precup & Singh (1999): four rooms, and a hallway through each wall between two.
FOUR_ROOMS = (
    "#############",
    "#     #     #",
    "#     #     #",
    "#           #",
    "#     #     #",
    "#     #     #",
    "## ####     #",
    "#     ### ###",
    "#     #     #",
    "#     #     #",
    "#           #",
    "#     #     #",
    "#############",
)


@dataclasses.dataclass(frozen=True)
class Maze:
    """A map and its size in the world, whose origin is the map's middle.

    Attributes:
      rows: the map, northern row first; "#" is a wall, the other tiles are free.
      cell: width of a cell, m.
      height: height of the walls, m.
    """

    rows: tuple[str, ...]
    cell: float
    height: float

    @functools.cached_property
    def walls(self) -> np.ndarray:
        """Centres of the walls' cells [W, 2], m."""
        return self._centres(WALL)

    @functools.cached_property
    def free(self) -> np.ndarray:
        """Centres of all other cells [F, 2], m."""
        return self._centres(FREE)

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Put the maze into the model of a robot, whose defaults for geoms the walls take.

        The goal, a sphere behind the robot in the tree, touches nothing. It stands on two slides,
        so that the last two entries of qpos are its x and y (m) and environments, which share one
        model, have a goal each; nothing moves it.
        """
        # All walls are the world's, and MuJoCo C would search a body of many geoms through a tree:
        # the plain tests of every pair find the same contacts, for the ant 1.2 times as fast.
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
        half = [self.cell / 2, self.cell / 2, self.height / 2]
        for x, y in self.walls:
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                pos=[x, y, self.height / 2],
                size=half,
                contype=1,
                conaffinity=1,
                rgba=[0.7, 0.5, 0.3, 1.0],
            )
        goal = spec.worldbody.add_body(name="goal", pos=[0.0, 0.0, self.height / 2])
        goal.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[self.cell / 5, 0.0, 0.0],
            mass=1.0,
            contype=0,
            conaffinity=0,
            rgba=[1.0, 0.0, 0.0, 0.7],
        )
        for name, axis in (("goal_x", [1, 0, 0]), ("goal_y", [0, 1, 0])):
            goal.add_joint(
                name=name,
                type=mujoco.mjtJoint.mjJNT_SLIDE,
                axis=axis,
                limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            )
        # From above: a camera that follows the robot would look at walls.
        for camera in list(spec.cameras):
            spec.delete(camera)
        extent = self.cell * max(len(self.rows), len(self.rows[0]))
        distance = self.height + extent / 2 / math.tan(math.radians(CAMERA_ANGLE / 2))
        spec.worldbody.add_camera(name="above", pos=[0.0, 0.0, distance], fovy=CAMERA_ANGLE)

    def centre(self, mark: str) -> np.ndarray:
        """Return the centre [2] of the one cell that holds a mark, m."""
        (centre,) = self._centres(mark)
        return centre

    def _centres(self, marks: str) -> np.ndarray:
        places = [
            ((j + 0.5) * self.cell, (i + 0.5) * self.cell)
            for i, row in enumerate(self.rows)
            for j, tile in enumerate(row)
            if tile in marks
        ]
        x, y = np.array(places).T
        width, depth = len(self.rows[0]) * self.cell, len(self.rows) * self.cell
        return np.stack([x - width / 2, depth / 2 - y], axis=1)
