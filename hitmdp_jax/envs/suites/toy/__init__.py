"""Small exact problems, without physics."""

from hitmdp_jax.envs.suites.base import Suite

SUITE = Suite(
    prefix="toy/",
    folder=__name__,
    solves=False,
    tasks={"turkey": "turkey:Turkey", "cue": "cue:Cue"},
)
