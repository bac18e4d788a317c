"""The Gym MuJoCo tasks, one file each, with Gymnasium's v4 and v5 semantics."""

from hitmdp_jax.envs.suites.base import Suite

SUITE = Suite(
    prefix="",
    folder=__name__,
    tasks={
        "halfcheetah": "half_cheetah:HalfCheetah",
        "swimmer": "swimmer:Swimmer",
        "humanoidstandup": "humanoid_standup:HumanoidStandup",
        "reacher": "reacher:Reacher",
        "walker2d": "walker2d:Walker2d",
        "hopper": "hopper:Hopper",
        "invertedpendulum": "inverted_pendulum:InvertedPendulum",
        "inverteddoublependulum": "inverted_double_pendulum:InvertedDoublePendulum",
        "ant": "ant:Ant",
        "humanoid": "humanoid:Humanoid",
    },
)
