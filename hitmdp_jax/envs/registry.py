"""How tasks are found, checked and made by name, and how a task of one's own gets a name."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import hitmdp_jax.quiet_mjx  # noqa: F401
from hitmdp_jax.checks import MOST, check_size
from hitmdp_jax.envs.action_repeat import ActionRepeat
from hitmdp_jax.envs.contract import check_task
from hitmdp_jax.envs.keywords import check_keywords
from hitmdp_jax.envs.suites import all_suites, find_suite
from hitmdp_jax.envs.suites.base import construct
from hitmdp_jax.errors import UsageError, out_of_domain, unknown_name
from hitmdp_jax.physics import DEFAULT_ENGINE, PhysicsChoice
from hitmdp_jax.plugins import is_own, label, load_class, require_class, trust

if TYPE_CHECKING:
    from brax.envs.base import Env

_registered: "dict[str, Callable[..., Env]]" = {}  # by `register_env`


def list_envs() -> tuple[str, ...]:
    """Return the names of this package's tasks and of those that were registered.

    `make_env` makes those of other libraries, too (`suite_names`).
    """
    ours = (name for suite in all_suites() if suite.ours for name in suite.names())
    return (*ours, *_registered)


def register_env(name: str, constructor: "Callable[..., Env]") -> None:
    """Give a task of your own a name, which this process then knows like any other.

    Args:
      name: the name; one that was registered before changes its meaning.
      constructor: a class, or any function, that returns a Brax `Env`. If it takes `physics` and
        `version`, it gets the engine and the version that `make_env` is given.

    Raises:
      UsageError: the name is one of a suite's, or it cannot be a name; or the constructor
        cannot be called, or is a class of no environments.

    >>> from hitmdp_jax.envs.suites.toy.turkey import Turkey
    >>> register_env("my_turkey", Turkey)
    >>> make_env("my_turkey").action_size
    1
    """
    if not isinstance(name, str) or not name or is_own(name):
        raise out_of_domain("name", repr(name), "a string that is not empty and names no file")
    if find_suite(name):
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
) -> "Env":
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
    task = check_env(name, version, action_repeat, **task_kwargs)
    if suite := find_suite(name):
        env = suite.make(name, physics, version, **task_kwargs)
    else:
        env = construct(task, physics, version, task_kwargs)
    _check_interface(name, env)
    check_task(env, f"'{label(name)}'")
    return env if action_repeat == 1 else ActionRepeat(env, action_repeat)


def check_env(
    name: str, version: str = "v5", action_repeat: int = 1, **task_kwargs: Any
) -> "Callable[..., Env]":
    """Return a task's constructor, having checked everything that can be checked without making it.

    What a task's models need may be missing: settings can be read where they cannot be run.

    Raises:
      UsageError: the name, version or a keyword is unknown, or a keyword's value is not valid.
    """
    if not isinstance(name, str):
        raise out_of_domain("env", repr(name), "the name of an environment, such as 'halfcheetah'")
    check_size("action_repeat", action_repeat, MOST)  # control steps are counted in int32
    if suite := find_suite(name):
        return suite.check(name, version, **task_kwargs)
    if name in _registered:
        task = _registered[name]
    elif is_own(name):
        task = load_class(name)
        _check_interface(name, task)
    else:
        require_class(name)
        raise unknown_name("environment", name, list_envs(), listed="hitmdp_jax.list_envs()")
    check_keywords(label(name), task, task_kwargs, domains=False)
    return task


def check_installed(name: str) -> None:
    """Check that what a task needs is installed.

    Raises:
      UsageError: an extra is missing.
    """
    if suite := find_suite(name):
        suite.check_installed()


def check_engine(name: str, physics: PhysicsChoice) -> None:
    """Reject an engine where a task brings its own physics.

    Raises:
      UsageError: it does and the engine is not the default.
    """
    if suite := find_suite(name):
        suite.check_engine(name, physics)


def engine_for(name: str, wanted: PhysicsChoice) -> PhysicsChoice:
    """Return the wanted engine, or the default one where a task brings its own physics."""
    suite = find_suite(name)
    return DEFAULT_ENGINE if suite and suite.own_physics else wanted


def _check_interface(name: str, env: Any) -> None:
    """Raise UsageError where an environment, or its class, is none."""
    if not (hasattr(env, "reset") and hasattr(env, "step")):
        raise UsageError(f"'{name}' makes no environment: its result has no reset and step.")
