"""Mazes in which a robot must reach a goal that is elsewhere in every episode."""

from hitmdp_jax.envs.suites.base import Suite

SUITE = Suite(
    prefix="maze/",
    folder=__name__,
    tasks={
        "point_fourrooms": "point:PointFourRooms",
        "point_umaze": "point:PointUMaze",
        "point_medium": "point:PointMediumMaze",
        "ant_umaze": "ant:AntUMaze",
    },
)
