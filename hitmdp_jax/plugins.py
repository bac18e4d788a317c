"""A user's own tasks and algorithms, named by file and class: `path/to/my_task.py:MyTask`.

Loading such a class runs its file, so a name that comes out of a run's folder must not suffice: the
folder may be a stranger's. A file is run only once it is trusted: a command line of this user has
named it, now or before, or whoever calls says so.
"""

import ast
import contextlib
import functools
import importlib.util
import inspect
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from hitmdp_jax.errors import UsageError, unknown_name

MOST_CLASSES = 5  # that a sentence names


def is_own(name: str) -> bool:
    """Return whether a name is of the form `path/to/file.py:Class`."""
    return ".py:" in name


def absolute(name: str) -> str:
    """Return the name with an absolute path, so that a run finds its file from any folder.

    Raises:
      UsageError: the path begins with the home folder of a user who is not known here.
    """
    return f"{_file(name)}:{name.rpartition(':')[2]}"


def label(name: str) -> str:
    """Return a short name for folders and titles: `my_task.MyTask` of `path/my_task.py:MyTask`."""
    if not is_own(name):
        return name
    path, _, class_name = name.rpartition(":")
    return f"{Path(path).stem}.{class_name}"


def trust(name: str, remember: bool = False) -> None:
    """Let this process run the file that a name names; names of no file are left alone.

    Args:
      name: as `load_class` takes it.
      remember: let this user's later processes run it as well.

    Raises:
      UsageError: as `absolute`.
    """
    if not is_own(name):
        return
    path = _file(name)
    _trusted.add(path)
    if remember and path not in _remembered() and str(path).isprintable():
        # Without a home, or with one that cannot be written, it has to be trusted each time.
        with contextlib.suppress(OSError, RuntimeError):
            own_files().parent.mkdir(parents=True, exist_ok=True)
            with own_files().open("a", encoding="utf-8") as file:
                file.write(f"{path}\n")


def own_files() -> Path:
    """Return the list, a path a line, of the files that this user's command lines have named.

    Raises:
      RuntimeError: the user has no home folder.
    """
    state = os.environ.get("XDG_STATE_HOME") or "~/.local/state"
    return Path(state).expanduser() / "hitmdp_jax" / "own_files"


def require_class(name: str) -> None:
    """Check that a name which is a Python file's also says which class of it; runs nothing.

    Raises:
      UsageError: it does not; names the file's classes.
    """
    path, _, class_name = name.rpartition(":") if is_own(name) else (name, "", "")
    if class_name or not path.endswith(".py"):
        return
    file = _file(f"{path}:")
    if not file.is_file():
        raise UsageError(f"'{name}' names no file: there is no '{path}' here.")
    classes = []
    with contextlib.suppress(SyntaxError, ValueError):  # its author sees them when it is run
        statements = ast.parse(file.read_bytes()).body
        classes = [f"{path}:{x.name}" for x in statements if isinstance(x, ast.ClassDef)]
    forms = " or ".join(classes[:MOST_CLASSES]) or f"{path}:Class"
    raise UsageError(f"'{name}' does not say which class of the file is meant: write {forms}.")


def load_class(name: str) -> type[Any]:
    """Return the class that `path/to/file.py:Class` names. Running the file is up to its author.

    Errors that the file itself raises are the author's to see, traceback and all.

    Raises:
      UsageError: there is no such file, nobody here trusts it, it has no such class, or the class
        is abstract.
    """
    require_class(name)
    path, _, class_name = name.rpartition(":")
    file = _file(name)
    if not file.is_file():
        raise UsageError(f"'{name}' names no file: there is no '{path}' here.")
    if file not in _trusted and file not in _remembered():
        raise UsageError(
            f"'{file}' would be executed, and no command line of yours has named it: if you trust "
            "it, add --trust (trust=true for train.py, trust=True in Python)."
        )
    module = _load(file)
    found = getattr(module, class_name, None)
    if not isinstance(found, type):
        own = [
            n for n, x in vars(module).items() if getattr(x, "__module__", "") == module.__name__
        ]
        classes = [n for n in own if isinstance(getattr(module, n), type)]
        raise unknown_name(f"class of {path}", class_name, classes)
    if inspect.isabstract(found):
        missing = ", ".join(sorted(found.__abstractmethods__))
        raise UsageError(f"'{name}' is abstract: it still needs {missing}.")
    return found


@functools.cache
def _load(path: Path) -> ModuleType:
    # One module a file: a class loaded twice would be two classes, and compile twice.
    spec = importlib.util.spec_from_file_location(f"hitmdp_jax_own.{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


_trusted: set[Path] = set()  # files that this process may run


def _remembered() -> set[Path]:
    try:
        text = own_files().read_text(encoding="utf-8", errors="replace")
    except (OSError, RuntimeError):
        return set()
    return set(map(Path, text.splitlines()))


def _file(name: str) -> Path:
    path = name.rpartition(":")[0]
    try:
        return Path(path).expanduser().resolve()
    except (RuntimeError, OSError, ValueError) as error:  # ~nobody; links in a circle; a NUL
        raise UsageError(f"'{name}' names no file: {error}") from None
