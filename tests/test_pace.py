"""Tests wait for events: none has a deadline of its own, and none measures how long it takes."""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
CLOCKS = ("monotonic", "perf_counter", "process_time", "thread_time")
LIMIT = 600  # s, the default of pytest-timeout in pyproject.toml, which ends what hangs


def faults(source):
    """Return the lines of a test file that a slow machine could make fail."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        limits = [word.value for word in node.keywords if word.arg in ("timeout", "deadline")]
        limits += node.args if name == "timeout" else []
        short = [x for x in limits if not isinstance(x, ast.Constant) or (x.value or LIMIT) < LIMIT]
        if short or name in CLOCKS:
            yield f"line {node.lineno}: {ast.unparse(node)}"


def test_nothing_depends_on_the_speed_of_the_machine():
    found = {path: list(faults(path.read_text())) for path in TESTS.rglob("*.py")}
    assert {path: lines for path, lines in found.items() if lines} == {}


@pytest.mark.parametrize(
    "source",
    [
        "process.communicate(timeout=10)",
        "start = time.monotonic()",
        "@settings(deadline=200)\ndef f(): ...",
        "@pytest.mark.timeout(120)\ndef f(): ...",
    ],
)
def test_what_depends_on_it_is_found(source):
    assert len(list(faults(source))) == 1
