"""Tasks by name. Names cost nothing: what checks and makes tasks is imported when it is used."""

from typing import TYPE_CHECKING

from hitmdp_jax import lazy

if TYPE_CHECKING:
    from hitmdp_jax.envs.registry import (
        check_engine,
        check_env,
        check_installed,
        engine_for,
        list_envs,
        make_env,
        register_env,
    )
    from hitmdp_jax.envs.suites import suite_names

__all__ = [
    "check_engine",
    "check_env",
    "check_installed",
    "engine_for",
    "list_envs",
    "make_env",
    "register_env",
    "suite_names",
]

__getattr__, __dir__ = lazy.attach(
    __name__, dict.fromkeys(__all__, "registry") | {"suite_names": "suites"}
)
