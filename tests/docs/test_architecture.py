"""docs/architecture.md: what it names is there, and imports go the way it says."""

import ast
import re

import pytest

from tests.docs.pages import ROOT

PAGE = (ROOT / "docs" / "architecture.md").read_text()
PACKAGE = ROOT / "hitmdp_jax"
NAMED = sorted(set(re.findall(r"`([\w/]+\.py)::([\w.]+)`", PAGE)))
FOLDERS = re.findall(r"^\| `(\w+)/` \|", PAGE, re.MULTILINE)
FILES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))
WALKS = PAGE.split("\n### ")[1:]


def names_of(statements, prefix=""):
    """Yield what a module or a class defines, dotted: functions, classes, fields, constants."""
    for x in statements:
        if isinstance(x, ast.FunctionDef | ast.ClassDef):
            yield prefix + x.name
        if isinstance(x, ast.ClassDef):
            yield from names_of(x.body, f"{prefix}{x.name}.")
        targets = x.targets if isinstance(x, ast.Assign) else [getattr(x, "target", None)]
        yield from (prefix + target.id for target in targets if isinstance(target, ast.Name))


@pytest.mark.parametrize("file", sorted({file for file, _ in NAMED}))
def test_what_the_page_names_exists(file):
    path = PACKAGE / file
    assert path.is_file()
    there = set(names_of(ast.parse(path.read_text()).body))
    assert {name for named, name in NAMED if named == file} <= there


def test_there_are_six_walks_each_a_line_of_steps_that_name_code():
    assert [walk[:2] for walk in WALKS] == [f"{i}." for i in range(1, 7)]
    for walk in WALKS:
        steps = re.split(r"\n\d+\. ", walk.split("\n## ")[0])[1:]
        assert len(steps) > 5
        assert all(re.search(r"`[\w/]+\.\w+(?:::[\w.]+)?`", step) for step in steps), walk


def test_the_table_has_every_folder_and_the_text_every_single_file():
    assert set(FOLDERS) == {path.parts[0] for path in FILES if len(path.parts) > 1}
    single = {path.name for path in FILES if len(path.parts) == 1} - {"__init__.py"}
    assert single <= set(re.findall(r"`(\w+\.py)`", PAGE))


def imported_by(path):
    """Yield the folders of the package that a file imports from, wherever in it."""
    for x in ast.walk(ast.parse((PACKAGE / path).read_text())):
        modules = [alias.name for alias in x.names] if isinstance(x, ast.Import) else []
        if isinstance(x, ast.ImportFrom) and x.module:
            modules = [x.module, *(f"{x.module}.{alias.name}" for alias in x.names)]
        for module in modules:
            first, _, rest = module.partition(".")
            if first == "hitmdp_jax" and rest.split(".")[0] in FOLDERS:
                yield rest.split(".")[0]


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_imports_from_those_above_it_alone(folder):
    allowed = set(FOLDERS[: FOLDERS.index(folder) + 1])
    for path in FILES:
        if path.parts[0] == folder:
            assert set(imported_by(path)) <= allowed, path


def test_single_files_import_no_folder():
    for path in FILES:
        if len(path.parts) == 1 and path.name not in ("__init__.py", "__main__.py"):
            assert not set(imported_by(path)), path


def test_every_function_can_be_seen_at_once():
    """It has 50 lines at most, its description among them."""
    long = [
        f"{path}::{node.name}: {node.end_lineno - node.lineno + 1}"
        for path in FILES
        for node in ast.walk(ast.parse((PACKAGE / path).read_text()))
        if isinstance(node, ast.FunctionDef) and node.end_lineno - node.lineno >= 50
    ]
    assert long == []
