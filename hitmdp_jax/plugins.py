"""A user's own tasks and algorithms, named by file and class: `path/to/my_task.py:MyTask`."""

import functools
import importlib.util
import inspect
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from hitmdp_jax.errors import UsageError, unknown_name


def is_own(name: str) -> bool:
    """Return whether a name is of the form `path/to/file.py:Class`."""
    return ".py:" in name


def absolute(name: str) -> str:
    """Return the name with an absolute path, so that a run finds its file from any folder."""
    path, _, class_name = name.rpartition(":")
    return f"{Path(path).expanduser().resolve()}:{class_name}"


def label(name: str) -> str:
    """Return a short name for folders and titles: `my_task.MyTask` of `path/my_task.py:MyTask`."""
    if not is_own(name):
        return name
    path, _, class_name = name.rpartition(":")
    return f"{Path(path).stem}.{class_name}"


def load_class(name: str) -> type[Any]:
    """Return the class that `path/to/file.py:Class` names. Running the file is up to its author.

    Errors that the file itself raises are the author's to see, traceback and all.

    Raises:
      UsageError: there is no such file, or no such class in it, or the class is abstract.
    """
    path, _, class_name = name.rpartition(":")
    file = Path(path).expanduser()
    if not file.is_file():
        raise UsageError(f"'{name}' names no file: there is no '{path}' here.")
    module = _load(file.resolve())
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
