"""Tasks by name."""

import importlib
from collections.abc import Callable
from typing import Any

from brax.envs.base import Env

from hitmdp_jax.checks import MOST, check_size
from hitmdp_jax.envs.action_repeat import ActionRepeat
from hitmdp_jax.envs.contract import check_task
from hitmdp_jax.envs.keywords import check_keywords, parameters_of
from hitmdp_jax.envs.suites.brax import BRAX, brax_task, check_engine
from hitmdp_jax.envs.suites.dmc.suite import require_suite
from hitmdp_jax.errors import UsageError, out_of_domain, unknown_name
from hitmdp_jax.physics import PhysicsChoice, find_engine
from hitmdp_jax.plugins import is_own, label, load_class, require_class, trust

__all__ = ["check_engine", "check_env", "check_installed", "list_envs", "make_env", "register_env"]

VERSIONS = ("v4", "v5")

# name -> (module, class); imported when first made, so that listing tasks costs nothing.
_REGISTRY = {
    "halfcheetah": ("gym.half_cheetah", "HalfCheetah"),
    "swimmer": ("gym.swimmer", "Swimmer"),
    "humanoidstandup": ("gym.humanoid_standup", "HumanoidStandup"),
    "reacher": ("gym.reacher", "Reacher"),
    "walker2d": ("gym.walker2d", "Walker2d"),
    "hopper": ("gym.hopper", "Hopper"),
    "invertedpendulum": ("gym.inverted_pendulum", "InvertedPendulum"),
    "inverteddoublependulum": ("gym.inverted_double_pendulum", "InvertedDoublePendulum"),
    "ant": ("gym.ant", "Ant"),
    "humanoid": ("gym.humanoid", "Humanoid"),
    "dmc/cartpole_balance": ("dmc.cartpole", "CartpoleBalance"),
    "dmc/cartpole_balance_sparse": ("dmc.cartpole", "CartpoleBalanceSparse"),
    "dmc/reacher_easy": ("dmc.reacher", "ReacherEasy"),
    "dmc/reacher_hard": ("dmc.reacher", "ReacherHard"),
    "dmc/cheetah_run": ("dmc.cheetah", "CheetahRun"),
    "dmc/cheetah_backward": ("dmc.cheetah", "CheetahBackward"),
    "dmc/fish_upright": ("dmc.fish", "FishUpright"),
    "dmc/fish_downleft": ("dmc.fish", "FishDownleft"),
    "dmc/walker_squat": ("dmc.walker", "WalkerSquat"),
    "dmc/walker_stand": ("dmc.walker", "WalkerStand"),
    "dmc/walker_walk": ("dmc.walker", "WalkerWalk"),
    "dmc/walker_backward": ("dmc.walker", "WalkerBackward"),
    "maze/point_fourrooms": ("maze.point", "PointFourRooms"),
    "maze/point_umaze": ("maze.point", "PointUMaze"),
    "maze/point_medium": ("maze.point", "PointMediumMaze"),
    "maze/ant_umaze": ("maze.ant", "AntUMaze"),
    "toy/turkey": ("toy.turkey", "Turkey"),
}

_registered: dict[str, Callable[..., Env]] = {}  # by `register_env`


def list_envs() -> tuple[str, ...]:
    """Return the names that `make_env` knows."""
    return (*_REGISTRY, *_registered)


def register_env(name: str, constructor: Callable[..., Env]) -> None:
    """Give a task of your own a name, which this process then knows like any other.

    Args:
      name: the name; one that was registered before changes its meaning.
      constructor: a class, or any function, that returns a Brax `Env`. If it takes `physics` and
        `version`, it gets the engine and the version that `make_env` is given.

    Raises:
      UsageError: the name is one of ours or of Brax's, or it cannot be a name; or the constructor
        cannot be called, or is a class of no environments.

    >>> from hitmdp_jax.envs.suites.toy.turkey import Turkey
    >>> register_env("my_turkey", Turkey)
    >>> make_env("my_turkey").action_size
    1
    """
    if not isinstance(name, str) or not name or is_own(name):
        raise out_of_domain("name", repr(name), "a string that is not empty and names no file")
    if name in _REGISTRY or name.startswith(BRAX):
        raise UsageError(f"'{name}' is a built-in environment: register yours under another name.")
    if not callable(constructor):
        raise out_of_domain("constructor", repr(constructor), "a class or function to call")
    if isinstance(constructor, type):
        _check_interface(name, constructor)
    _registered[name] = constructor


def make_env(
    name: str,
    *,
    physics: PhysicsChoice = "mjx",
    version: str = "v5",
    action_repeat: int = 1,
    **task_kwargs: Any,
) -> Env:
    """Make a task: a Brax `Env`, unbatched and without auto-reset.

    Args:
      name: one of `list_envs()`, "brax/<name>" for one of Brax's own, or a class of yours as
        "path/to/my_task.py:MyTask".
      physics: "mjx" (XLA, any device), "native" (MuJoCo C on the CPU) or "warp" (NVIDIA), or an
        `Engine`. Brax's own environments choose theirs by the keyword `backend`; tasks without
        MuJoCo have no use for it.
      version: "v5" or "v4", Gymnasium's semantics of that name; other tasks have one version only.
      action_repeat: control steps that each action is held for; see `ActionRepeat`.
      **task_kwargs: the task's own keywords, e.g. `ctrl_cost_weight=0.2`.

    Raises:
      UsageError: the name, engine, version or a keyword is unknown, a keyword's value is not valid,
        an extra is missing, or a task of your own cannot be trained on (`contract.check_task`).
        What a class of your own raises is raised as it is.

    >>> env = make_env("halfcheetah", physics="native")
    >>> env.observation_size, env.action_size
    (17, 6)
    """
    if isinstance(name, str):
        trust(name)  # whoever calls has named it
    given = {"physics": find_engine(physics), "version": version}
    task = check_env(name, version, action_repeat, **task_kwargs)
    takes = parameters_of(task)
    env = task(**{k: x for k, x in given.items() if k in takes}, **task_kwargs)
    _check_interface(name, env)
    check_task(env, f"'{label(name)}'")
    return env if action_repeat == 1 else ActionRepeat(env, action_repeat)


def check_env(
    name: str, version: str = "v5", action_repeat: int = 1, **task_kwargs: Any
) -> Callable[..., Env]:
    """Return a task's constructor, having checked everything that can be checked without making it.

    What a task's models need may be missing: settings can be read where they cannot be run.

    Raises:
      UsageError: the name, version or a keyword is unknown, or a keyword's value is not valid.
    """
    if not isinstance(name, str):
        raise out_of_domain("env", repr(name), "the name of an environment, such as 'halfcheetah'")
    check_size("action_repeat", action_repeat, MOST)  # control steps are counted in int32
    if name.startswith(BRAX):
        return brax_task(name, **task_kwargs)
    if name in _REGISTRY:
        if not isinstance(version, str) or version not in VERSIONS:
            raise unknown_name("version", str(version), VERSIONS)
        module, class_name = _REGISTRY[name]
        task = getattr(importlib.import_module(f"hitmdp_jax.envs.suites.{module}"), class_name)
    elif name in _registered:
        task = _registered[name]
    elif is_own(name):
        task = load_class(name)
        _check_interface(name, task)
    else:
        require_class(name)
        raise unknown_name("environment", name, list_envs(), listed="hitmdp_jax.list_envs()")
    check_keywords(label(name), task, task_kwargs, domains=name in _REGISTRY)
    return task


def check_installed(name: str) -> None:
    """Check that what a task's models need is installed.

    Raises:
      UsageError: an extra is missing.
    """
    if name.startswith("dmc/"):
        require_suite()


def _check_interface(name: str, env: Any) -> None:
    """Raise UsageError where an environment, or its class, is none."""
    if not (hasattr(env, "reset") and hasattr(env, "step")):
        raise UsageError(f"'{name}' makes no environment: what it makes has no reset and step.")
