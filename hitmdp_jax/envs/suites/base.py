"""`Suite`: a family of tasks that are found, made and run in one way."""

import dataclasses
import functools
import importlib.util
import inspect
import pkgutil
import types
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NoReturn

from hitmdp_jax.errors import UsageError, missing_extra, unknown_name

if TYPE_CHECKING:  # names are listed without JAX, Brax and MuJoCo, which take seconds to import
    from brax.envs.base import Env

    from hitmdp_jax.physics import PhysicsChoice

VERSIONS = ("v4", "v5")
WRITTEN = (bool, int, float, str, tuple, types.NoneType)  # defaults that a setting can hold


@dataclasses.dataclass(frozen=True)
class Suite:
    """A family of tasks.

    A suite is one file, or one folder, here: it holds a `SUITE` and has its line in `SUITES`. The
    tasks of another library are a `LibrarySuite`.

    How an episode ends: `done` means that the task ended it, and `VectorEnv` applies the time limit
    `episode_length`. An environment that ends itself by time must say so in
    `state.info["truncation"]`, 1 where it did, as Brax's `EpisodeWrapper` and MuJoCo Playground do.
    Where a library says it otherwise, `make` translates.

    Attributes:
      prefix: what the names of its tasks begin with, such as "dmc/".
      package: the package of Python that its tasks need beside this one's own, if any.
      extra: the extra of this package that installs it.
      own_physics: whether its tasks bring physics of their own, so that no engine is chosen.
      solves: whether a step may solve systems of equations, as MJX's does: many of those at once
        need more threads (`runs.host.set_up_host`).
      ours: whether the tasks are written in this package, so that `list_envs` lists them.
      folder: the package that holds the modules of `tasks`.
      tasks: the name without the prefix -> "module:Class", imported when the task is first made, so
        that listing tasks costs nothing.
    """

    prefix: str
    package: str | None = None
    extra: str = ""
    own_physics: bool = False
    solves: bool = True
    ours: bool = True
    folder: str = ""
    tasks: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def names(self) -> tuple[str, ...]:
        """Return the full names of its tasks."""
        return tuple(self.prefix + task for task in self.tasks)

    def constructor(self, name: str) -> "Callable[..., Env]":
        """Return the constructor of the task with that full name, one of `names()`."""
        import hitmdp_jax.quiet_mjx  # noqa: F401  # before the task's module imports Brax

        return pkgutil.resolve_name(f"{self.folder}.{self.tasks[name.removeprefix(self.prefix)]}")

    def check(self, name: str, version: str = "v5", **keywords: Any) -> "Callable[..., Env]":
        """Return a task's constructor, having checked the version and the keywords.

        Raises:
          UsageError: the name, the version or a keyword is unknown, or a value is not valid.
        """
        self.check_name(name, version)
        from hitmdp_jax.envs.keywords import check_keywords

        task = self.constructor(name)
        check_keywords(name, task, keywords)
        return task

    def check_name(self, name: str, version: str) -> None:
        """Check a task's full name and version; raises as `check`."""
        if name not in self.names():
            raise unknown_name("environment", name, self.names())
        if not isinstance(version, str) or version not in VERSIONS:
            raise unknown_name("version", str(version), VERSIONS)

    def check_engine(self, name: str, physics: "PhysicsChoice") -> None:
        """Reject an engine where a task brings its own physics.

        Raises:
          UsageError: it does and the engine is not the default; or there is no such engine.
        """
        from hitmdp_jax.physics import DEFAULT_ENGINE, find_engine

        if find_engine(physics).name != DEFAULT_ENGINE and self.own_physics:
            raise UsageError(f"{name} has its own physics: physics must stay at its default.")

    @property
    def installed(self) -> bool:
        """Whether the package that its tasks need is there."""
        return self.package is None or importlib.util.find_spec(self.package) is not None

    def check_installed(self) -> None:
        """Check that what its tasks need is installed.

        Raises:
          UsageError: it is not.
        """
        if not self.installed:
            raise missing_extra(self.extra, f"A task of {self.prefix.rstrip('/')}")

    def make(
        self, name: str, physics: "PhysicsChoice", version: str = "v5", **keywords: Any
    ) -> "Env":
        """Make a task.

        Raises:
          UsageError: as `check`, `check_engine` and `check_installed`.
        """
        task = self.check(name, version, **keywords)
        self.check_engine(name, physics)
        self.check_installed()
        return construct(task, physics, version, keywords)


@dataclasses.dataclass(frozen=True)
class LibrarySuite(Suite):
    """The tasks of another library, which bring physics of their own.

    In `tasks` stands with each name a function that returns the constructor of the task of that
    name, and that may import the library. Where the library is not installed the settings of a run
    can still be read, though their keywords are not checked.
    """

    own_physics: bool = True
    ours: bool = False

    def constructor(self, name: str) -> "Callable[..., Env]":
        """Return the constructor of the task with that full name, one of `names()`."""
        find: Callable[[str], Callable[..., Env]] = super().constructor(name)  # pyright: ignore
        return find(name.removeprefix(self.prefix))

    def check(self, name: str, version: str = "v5", **keywords: Any) -> "Callable[..., Env]":
        """Return a task's constructor, having checked what can be, as `Suite.check`."""
        if self.installed:
            return super().check(name, version, **keywords)
        self.check_name(name, version)
        missing = functools.partial(self._missing)
        vars(missing)["traced"] = None  # the library would know
        return missing

    def _missing(self, **keywords: Any) -> NoReturn:
        raise missing_extra(self.extra, f"A task of {self.prefix.rstrip('/')}")


def with_keywords(
    make: "Callable[..., Env]", defaults: Mapping[str, Any], traced: tuple[str, ...] = ()
) -> "Callable[..., Env]":
    """Let a function that takes any keywords say which: those with a default that can be written.

    Args:
      make: the function, such as a `functools.partial`.
      defaults: keyword -> its default.
      traced: those that are inputs of the program (`envs.numbers`).
    """
    kind = inspect.Parameter.KEYWORD_ONLY
    written = {name: x for name, x in defaults.items() if isinstance(x, WRITTEN)}
    parameters = [inspect.Parameter(name, kind, default=x) for name, x in written.items()]
    vars(make).update(__signature__=inspect.Signature(parameters), traced=traced)
    return make


def construct(
    task: "Callable[..., Env]", physics: "PhysicsChoice", version: str, keywords: Mapping[str, Any]
) -> "Env":
    """Call a task's constructor, with the engine and the version where it takes them."""
    from hitmdp_jax.envs.keywords import parameters_of
    from hitmdp_jax.physics import find_engine

    given = {"physics": find_engine(physics), "version": version}
    takes = parameters_of(task)
    return task(**{k: x for k, x in given.items() if k in takes}, **keywords)
