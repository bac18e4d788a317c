"""The DeepMind Control tasks (Tassa et al. 2018): one file per domain."""

from hitmdp_jax.envs.suites.base import Suite

SUITE = Suite(
    prefix="dmc/",
    package="dm_control",
    extra="dmc",
    folder=__name__,
    tasks={
        "cartpole_balance": "cartpole:CartpoleBalance",
        "cartpole_balance_sparse": "cartpole:CartpoleBalanceSparse",
        "reacher_easy": "reacher:ReacherEasy",
        "reacher_hard": "reacher:ReacherHard",
        "cheetah_run": "cheetah:CheetahRun",
        "cheetah_backward": "cheetah:CheetahBackward",
        "fish_upright": "fish:FishUpright",
        "fish_downleft": "fish:FishDownleft",
        "walker_squat": "walker:WalkerSquat",
        "walker_stand": "walker:WalkerStand",
        "walker_walk": "walker:WalkerWalk",
        "walker_backward": "walker:WalkerBackward",
    },
)
