"""The families of tasks: one file or folder each."""

import functools
import importlib

from hitmdp_jax.envs.suites.base import Suite

__all__ = ["SUITES", "Suite", "all_suites", "find_suite", "suite_names"]

SUITES = (  # modules of this package, each with a `SUITE`
    "gym",
    "dmc",
    "maze",
    "trap",
    "toy",
    "brax",
    "gymnax",
    "xminigrid",
    "craftax",
    "playground",
)


@functools.cache
def all_suites() -> tuple[Suite, ...]:
    """Return the suites."""
    modules = (importlib.import_module(f"{__name__}.{name}") for name in SUITES)
    return tuple(module.SUITE for module in modules)


def suite_names() -> tuple[str, ...]:
    """Return the names of the tasks of all suites."""
    return tuple(name for suite in all_suites() for name in suite.names())


def find_suite(name: str) -> Suite | None:
    """Return the suite that a task's name belongs to, whether it has such a task or not.

    None is returned for a name without the prefix of a suite that is no task of Gymnasium's, whose
    names have no prefix.
    """
    for suite in all_suites():
        if name in suite.names() or (suite.prefix and name.startswith(suite.prefix)):
            return suite
    return None
