"""The settings of a run among those that a command line named, each of its kind."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hitmdp_jax import plugins
from hitmdp_jax.checks import true_or_false
from hitmdp_jax.cli import tasks
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.folder import check_replaceable

if TYPE_CHECKING:  # it imports all that trains, which takes seconds
    from hitmdp_jax.runs.config import RunConfig

HOST_SETTINGS = (
    "resume",
    "run_dir",
    "overwrite",
    "report",
    "distributed",
    "trust",
)  # of the command line, not of the run


def run_config(values: dict[str, Any], trust: bool = True) -> "RunConfig":
    """Return a run's validated settings among a command line's values.

    A task's keywords that were given no value have their defaults there.

    Args:
      values: every setting by name.
      trust: run the files that they name, and remember that this user's command line named them.

    Raises:
      UsageError: as `RunConfig.from_mapping`.
    """
    from hitmdp_jax.runs.config import RunConfig, trust_named

    if isinstance(names := values.get("callbacks"), list | str):
        listed = [names] if isinstance(names, str) else names
        own = [
            plugins.absolute(x) if isinstance(x, str) and plugins.is_own(x) else x for x in listed
        ]
        values = values | {"callbacks": own}
    if trust:
        trust_named(values, remember=True)
    values = {name: x for name, x in values.items() if name not in HOST_SETTINGS}
    if (source := folder_setting(values, "init_from")) is not None:
        values["init_from"] = str(source.absolute())
    values["env"] = task_setting(values)
    return RunConfig.from_mapping(values)


def task_setting(values: Mapping[str, Any]) -> Any:
    """Return the task among a command line's values, its keywords in full; if it is one."""
    task = values["env"]
    named = isinstance(task, dict) and isinstance(task.get("name"), str)
    return tasks.defaults(task["name"]) | task if named else task


def flag_setting(values: dict[str, Any], name: str) -> bool:
    """Return a setting that is true or false.

    Raises:
      UsageError: it is neither.
    """
    return true_or_false(name, values.get(name, False))


def folder_setting(values: dict[str, Any], name: str = "run_dir") -> Path | None:
    """Return a folder that was named, or None.

    Raises:
      UsageError: the name is empty, or no name.
    """
    value = values.get(name)
    if value is None:
        return None
    named = isinstance(value, str | int | float) and not isinstance(value, bool)
    if not named or not str(value).strip():
        raise UsageError(f"{name} = {value!r} names no folder.")
    try:
        str(value).encode()
    except UnicodeEncodeError:  # whatever writes checkpoints takes no other names
        raise UsageError(
            f"{name} = {value!a} cannot be read as UTF-8 here: set LC_ALL=C.UTF-8, or name "
            "another folder."
        ) from None
    try:
        return Path(str(value)).expanduser()
    except RuntimeError:
        raise UsageError(
            f"{name} = {value} begins with the home folder of an unknown user."
        ) from None


def writable(name: str, path: Path, within: str = "") -> Path:
    """Return a path that is to be written after hours of work, having made sure now that it can be.

    Args:
      name: the setting or flag that names it.
      path: a file or, of a folder, what `within` is a file of.
      within: the file's name.

    Raises:
      UsageError: it cannot be written.
    """
    try:
        check_replaceable(path / within)
    except NotADirectoryError:
        raise UsageError(f"{name} = {path} cannot be written: a file is in its way.") from None
    except OSError as error:
        raise UsageError(f"{name} = {path} cannot be written: {error.strerror}.") from None
    return path
