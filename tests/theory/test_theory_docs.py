import doctest
import importlib
import pathlib
import re

import pytest

from hitmdp_jax import theory

ROOT = pathlib.Path(__file__).parents[2]
TESTS = {
    (path.name, name)
    for path in (ROOT / "tests/theory").glob("test_*.py")
    for name in re.findall(r"^def (test_\w+)", path.read_text(), re.MULTILINE)
}


@pytest.mark.parametrize("page", ["theory.md", "errata.md"])
def test_every_test_that_the_page_names_exists(page):
    named = set(re.findall(r"`(test_\w+\.py)::(test_\w+)`", (ROOT / "docs" / page).read_text()))
    assert len(named) > 10
    assert named <= TESTS


@pytest.mark.parametrize("page", ["theory.md", "errata.md"])
def test_every_function_that_the_page_names_exists(page):
    text = (ROOT / "docs" / page).read_text()
    named = set(re.findall(r"`([A-Za-z_]+)\(", text)) | set(re.findall(r"`theory\.(\w+)", text))
    names = ("variance", "hit_mdp", "turkey", "trajectories")
    modules = [theory, *(importlib.import_module(f"{theory.__name__}.{name}") for name in names)]
    assert {name for name in named if not any(hasattr(m, name) for m in modules)} == set()


def test_no_module_is_long():
    for path in (ROOT / "hitmdp_jax/theory").glob("*.py"):
        assert len(path.read_text().splitlines()) < 200, path.name


def test_the_pages_example_runs():
    result = doctest.testfile(str(ROOT / "docs/theory.md"), module_relative=False)
    assert result.attempted > 0
    assert result.failed == 0
