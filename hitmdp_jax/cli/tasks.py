"""The tasks among which `env=` chooses, and what their keywords mean, without importing a task."""

import ast
import functools
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore

from hitmdp_jax.envs.suites import find_suite, suite_names

PLAIN = (bool, int, float, str, type(None), tuple)  # what a setting can hold
HANDED_ON = re.compile(r"^  \*\*\w+: ", re.MULTILINE)  # keywords that the class above explains
EXPLAINED = re.compile(r"^  (\w+): (.*(?:\n    .*)*)", re.MULTILINE)


@functools.cache  # Hydra keeps them as long as the process lives
def store_tasks() -> tuple[str, ...]:
    """Give Hydra a configuration of each task, which holds its name; return the names."""
    names = suite_names()
    for name in names:
        group, _, choice = f"env/{name}".rpartition("/")
        ConfigStore.instance().store(group=group, name=choice, node={"name": name})
    return names


def defaults(name: str) -> dict[str, Any]:
    """Return the defaults of a task's keywords, of those that can be written down.

    A task of one's own, and one that is unknown, has none here.
    """
    from hitmdp_jax.envs.keywords import defaults_of

    suite = find_suite(name)
    if suite is None or name not in suite.names():
        return {}
    every = defaults_of(suite.check(name), {"physics"})
    return {keyword: x for keyword, x in every.items() if isinstance(x, PLAIN)}


def keywords(name: str) -> dict[str, str]:
    """Return the meanings of a task's keywords, by keyword, from the docstring of its class.

    Where it says nothing, as another library's does, the class is imported for the keywords alone.
    """
    suite, found = find_suite(name), {}
    if suite is not None and suite.ours:
        module, _, class_name = suite.tasks[name.removeprefix(suite.prefix)].partition(":")
        for explained in _explained(f"{suite.folder}.{module}", class_name):
            found = explained | found
        found.pop("physics", None)
    return found or dict.fromkeys(defaults(name), "")


def _explained(module: str, class_name: str) -> Iterator[dict[str, str]]:
    """Yield the text under "Args" of a class, then that of the parent classes it points to."""
    spec = importlib.util.find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    imported = {
        name.name: x.module
        for x in tree.body
        if isinstance(x, ast.ImportFrom) and x.module
        for name in x.names
    }
    classes = {x.name: x for x in tree.body if isinstance(x, ast.ClassDef)}
    if class_name not in classes:
        yield from _explained(imported[class_name], class_name)
        return
    this = classes[class_name]
    part = (ast.get_docstring(this) or "").partition("\nArgs:\n")[2].partition("\n\n")[0]
    yield {keyword: " ".join(text.split()) for keyword, text in EXPLAINED.findall(part)}
    if not part or HANDED_ON.search(part):
        for base in this.bases:
            if isinstance(base, ast.Name) and imported.get(base.id, module).startswith(
                "hitmdp_jax"
            ):
                yield from _explained(module, base.id)
