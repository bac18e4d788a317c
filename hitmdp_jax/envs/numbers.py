"""Numbers of a task that are inputs of the program, so that it can try many of them at once.

A task lists in `traced` those of its keywords that it keeps under their own names, and reads in
`reset` and `step` alone. Whatever it computed from a keyword when it was made would be out of date.
A task that keeps them elsewhere has a method `with_numbers`, which returns a changed copy.
"""

import copy
from collections.abc import Iterable, Mapping
from typing import Any

from brax.envs.base import Env, Wrapper

from hitmdp_jax.errors import unknown_name


def traced_of(task: Any, asked: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the keywords that a task, or what makes it, lists in `traced`.

    Args:
      task: the task, its class or another constructor.
      asked: those that are returned where the library that would know is not installed.
    """
    listed = getattr(task, "traced", ())
    return tuple(asked if listed is None else listed)


def with_numbers(env: Env, numbers: Mapping[str, Any]) -> Env:
    """Return a task with other numbers, which may be traced; the given one stays as it is.

    Args:
      env: the task, unbatched; it may be wrapped.
      numbers: keyword -> its value [].

    Raises:
      UsageError: the task does not list a keyword in `traced`.
    """
    changed = copy.copy(env)
    if isinstance(changed, Wrapper):
        changed.env = with_numbers(changed.env, numbers)
        return changed
    for name in numbers:
        if name not in traced_of(env):
            raise unknown_name(f"traced number of {type(env).__name__}", name, traced_of(env))
    if (own := getattr(env, "with_numbers", None)) is not None:
        return own(numbers)
    vars(changed).update(numbers)
    return changed
