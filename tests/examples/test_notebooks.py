"""The notebooks in examples/: what they import is there, and they run from top to bottom."""

import ast
import importlib
import json
import re
from pathlib import Path

import matplotlib as mpl
import pytest

FOLDER = Path(__file__).parents[2] / "examples"
NOTEBOOKS = sorted(path.name for path in FOLDER.glob("*.ipynb"))
SMALL = {"NUM_STEPS": 4096, "EPISODES": 2}


def cells(name):
    return json.loads((FOLDER / name).read_text())["cells"]


def code(name):
    return ["".join(cell["source"]) for cell in cells(name) if cell["cell_type"] == "code"]


def test_there_are_two():
    assert NOTEBOOKS == ["first_run.ipynb", "pure_functions.ipynb"]


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_it_holds_no_outputs(name):
    made = [cell for cell in cells(name) if cell["cell_type"] == "code"]
    assert made
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in made)


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_every_name_that_it_takes_from_a_module_exists(name):
    tree = ast.parse("\n".join(code(name)))
    modules = {}  # what a name in the notebook means
    for x in ast.walk(tree):
        if isinstance(x, ast.ImportFrom):
            assert x.module is not None
            modules |= {
                alias.name: getattr(importlib.import_module(x.module), alias.name, None)
                or importlib.import_module(f"{x.module}.{alias.name}")
                for alias in x.names
            }
        if isinstance(x, ast.Import):
            modules |= {a.asname or a.name: importlib.import_module(a.name) for a in x.names}
    for x in ast.walk(tree):
        if isinstance(x, ast.Attribute) and isinstance(x.value, ast.Name) and x.value.id in modules:
            assert hasattr(modules[x.value.id], x.attr), ast.unparse(x)


@pytest.mark.slow
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_it_runs_from_top_to_bottom(name):
    mpl.use("Agg")
    names = {"__name__": "__main__"}
    for cell in code(name):
        for size, value in SMALL.items():
            cell = re.sub(rf"^{size} = \S+", f"{size} = {value}", cell, flags=re.MULTILINE)
        exec(compile(cell, name, "exec"), names)
