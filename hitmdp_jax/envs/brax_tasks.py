"""Brax's own environments under our names: `brax/<name>`."""

import functools
import inspect
from collections.abc import Callable
from typing import Any

import brax.envs
from brax.envs.base import Env

from hitmdp_jax.envs.physics import PhysicsChoice
from hitmdp_jax.errors import UsageError, unknown_name

BRAX = "brax/"
EPISODE_LENGTH = 1000  # control steps: Brax's own default, which its environments do not carry


def brax_task(name: str, **task_kwargs: Any) -> Callable[..., Env]:
    """Return the constructor of a registered Brax environment, having checked its keywords.

    Args:
      name: "brax/<name>", with a name that Brax's registry knows.
      **task_kwargs: the constructor's keywords, e.g. `backend="spring"`.

    Raises:
      UsageError: the name or a keyword is unknown.
    """
    registered = brax.envs._envs  # the registry has no public listing
    task = registered.get(name.removeprefix(BRAX))
    if task is None:
        raise unknown_name("environment", name, [BRAX + known for known in registered])
    # Constructors hand the keywords that they do not name to that of the class above.
    known = {
        parameter.name
        for parent in task.__mro__
        for parameter in inspect.signature(parent.__init__).parameters.values()
        if parameter.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
    } - {"self", "sys"}
    for keyword in task_kwargs:
        if keyword not in known:
            raise unknown_name(f"keyword of {name}", keyword, known)
    return functools.partial(_make, task, name)


def _make(task: Callable[..., Env], name: str, physics: PhysicsChoice, **task_kwargs: Any) -> Env:
    if physics != "mjx":
        raise UsageError(
            f"{name} brings Brax's own physics, chosen by backend (generalized, spring, "
            "positional or mjx); physics must stay at its default."
        )
    env = task(**task_kwargs)
    env.episode_length = EPISODE_LENGTH  # pyright: ignore[reportAttributeAccessIssue]
    return env
