"""Craftax (Matthews et al. 2024), worlds to survive in, seen as symbols."""

from hitmdp_jax.envs.suites.base import LibrarySuite

NAMES = (
    "Craftax-Classic-Symbolic-v1",
    "Craftax-Symbolic-v1",
)
SUITE = LibrarySuite(
    prefix="craftax/",
    package="craftax",
    extra="craftax",
    solves=False,
    folder=__name__,
    tasks=dict.fromkeys(NAMES, "task:constructor"),
)
