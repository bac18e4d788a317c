"""Tasks by name."""

import importlib
import inspect
from collections.abc import Callable
from typing import Any

from brax.envs.base import Env

from hitmdp_jax.envs.brax_tasks import BRAX, brax_task
from hitmdp_jax.envs.dmc.suite import require_suite
from hitmdp_jax.envs.physics import PhysicsChoice
from hitmdp_jax.errors import unknown_name

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
    "toy/turkey": ("toy.turkey", "Turkey"),
}


def list_envs() -> tuple[str, ...]:
    """Return the names that `make_env` knows."""
    return tuple(_REGISTRY)


def make_env(
    name: str, *, physics: PhysicsChoice = "mjx", version: str = "v5", **task_kwargs: Any
) -> Env:
    """Make a task: a Brax `Env`, unbatched and without auto-reset.

    Args:
      name: one of `list_envs()`, or "brax/<name>" for one of Brax's own.
      physics: "mjx" (XLA, any device), "native" (MuJoCo C on the CPU) or "warp" (NVIDIA). Brax's
        own environments choose theirs by the keyword `backend`.
      version: "v5" or "v4", Gymnasium's semantics of that name; other tasks have one version only.
      **task_kwargs: the task's own keywords, e.g. `ctrl_cost_weight=0.2`.

    Raises:
      UsageError: the name, engine, version or a keyword is unknown, or an extra is missing.

    >>> env = make_env("halfcheetah", physics="native")
    >>> env.observation_size, env.action_size
    (17, 6)
    """
    task = check_env(name, version, **task_kwargs)
    if "version" in inspect.signature(task).parameters:
        task_kwargs["version"] = version
    return task(physics=physics, **task_kwargs)


def check_env(name: str, version: str = "v5", **task_kwargs: Any) -> Callable[..., Env]:
    """Return the class of a task, having checked everything that can be checked without making it.

    Raises:
      UsageError: the name, version or a keyword is unknown, or an extra is missing.
    """
    if name.startswith(BRAX):
        return brax_task(name, **task_kwargs)
    if name not in _REGISTRY:
        raise unknown_name("environment", name, _REGISTRY)
    if version not in VERSIONS:
        raise unknown_name("version", version, VERSIONS)
    if name.startswith("dmc/"):
        require_suite()
    module, class_name = _REGISTRY[name]
    task = getattr(importlib.import_module(f"hitmdp_jax.envs.{module}"), class_name)
    known = [
        p.name
        for p in inspect.signature(task).parameters.values()
        if p.kind is inspect.Parameter.KEYWORD_ONLY
    ]
    for keyword in task_kwargs:
        if keyword not in known:
            raise unknown_name(f"keyword of {name}", keyword, known)
    return task
