"""Tasks whose straight way is a trap: to reach the goal, the robot must first go away from it."""

from hitmdp_jax.envs.suites.base import Suite

SUITE = Suite(
    prefix="trap/",
    folder=__name__,
    tasks={
        "cheetah_switch": "switch:CheetahSwitch",
        "ant_switch": "switch:AntSwitch",
        "point": "pocket:PointPocket",
        "point_long": "pocket:PointLongPocket",
        "ant": "pocket:AntPocket",
        "ant_long": "pocket:AntLongPocket",
    },
)
