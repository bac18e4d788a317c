"""Brax's own environments under our names: `brax/<name>`."""

import functools
from collections.abc import Callable
from typing import Any

import brax.envs
from brax.envs.base import Env

from hitmdp_jax.envs.keywords import check_keywords
from hitmdp_jax.errors import UsageError, unknown_name
from hitmdp_jax.physics import PhysicsChoice, find_engine

BRAX = "brax/"
BACKENDS = ("generalized", "spring", "positional", "mjx")
EPISODE_LENGTH = 1000  # control steps: Brax's own default, which its environments do not carry


def brax_task(name: str, **task_kwargs: Any) -> Callable[..., Env]:
    """Return the constructor of a registered Brax environment, having checked its keywords.

    Args:
      name: "brax/<name>", with a name that Brax's registry knows.
      **task_kwargs: the constructor's keywords, e.g. `backend="spring"`.

    Raises:
      UsageError: the name, the back end or a keyword is unknown, or a value is not valid.
    """
    registered = brax.envs._envs  # the registry has no public listing
    task = registered.get(name.removeprefix(BRAX))
    if task is None:
        raise unknown_name("environment", name, [BRAX + known for known in registered])
    check_keywords(name, task, task_kwargs)
    if task_kwargs.get("backend", BACKENDS[0]) not in BACKENDS:
        raise unknown_name("backend", task_kwargs["backend"], BACKENDS)
    return functools.partial(_make, task, name)


def check_engine(name: str, physics: PhysicsChoice) -> None:
    """Reject an engine that a task has no use for.

    Raises:
      UsageError: the task is one of Brax's own and the engine is not the default.
    """
    if name.startswith(BRAX) and find_engine(physics).name != "mjx":
        raise UsageError(
            f"{name} brings Brax's own physics, chosen by backend ({', '.join(BACKENDS)}); "
            "physics must stay at its default."
        )


def _make(task: Callable[..., Env], name: str, physics: PhysicsChoice, **task_kwargs: Any) -> Env:
    check_engine(name, physics)
    env = task(**task_kwargs)
    env.episode_length = EPISODE_LENGTH  # pyright: ignore[reportAttributeAccessIssue]
    return env
