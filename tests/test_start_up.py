"""What is imported before it is needed: of what takes seconds to import, nothing."""

import json
import subprocess
import sys

import pytest

from hitmdp_jax.__main__ import COMMANDS

HEAVY = ("jax", "brax", "mujoco", "flax", "distrax", "orbax", "matplotlib", "plotly", "scipy")
HELP = [[], ["--help"], *([name, "--help"] for name in COMMANDS)]
HELP += [["train", "env=humanoid", "algo=ppo", "--help"]]
MISTAKES = [
    ["trian"],
    ["train", "env=halfchetah"],
    ["train", "env=dmc/cheetah_rum"],
    ["train", "-m", "env=hopper,halfchetah"],
    ["train", "algo=pppo"],
    ["train", "algo.lrr=1"],
    ["train", "env.ctrl_cost_wieght=0.2"],
    ["train", "ctrl_cost_weight=0.2"],
    ["train", "seeds"],
    ["train", "--seeds=4"],
    *([name, "no_such_run"] for name in ("evaluate", "report", "video", "export")),
    ["evaluate", "no_such_run", "--episodez", "3"],
    ["report"],
    ["experiment", "embeding"],
    ["figure", "figur7"],
    ["figure", "figure7", "no_such_run"],
]
# One process for all of them: each would take half a second to start.
SCRIPT = """
import contextlib, io, json, sys
from hitmdp_jax.__main__ import main

lines, heavy = json.loads(sys.argv[1])
for line in lines:
    sys.argv, code, nowhere = ["hitmdp", *line], 0, io.StringIO()
    with contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
        try:
            main()
        except SystemExit as stop:
            code = stop.code or 0
    print(json.dumps([line, code, [name for name in heavy if name in sys.modules]]))
"""


def output_of(script, *arguments):
    command = [sys.executable, "-c", script, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def test_help_and_the_answer_to_a_mistake_import_nothing_heavy():
    out = output_of(SCRIPT, json.dumps([HELP + MISTAKES, HEAVY]))
    found = [json.loads(line) for line in out.splitlines()]
    wanted = [[line, code, []] for lines, code in ((HELP, 0), (MISTAKES, 2)) for line in lines]
    assert found == wanted


def test_the_package_imports_what_a_name_needs_when_it_is_used():
    script = f"""
import sys
import hitmdp_jax
from hitmdp_jax.envs import suite_names

assert {{"train", "agents", "UsageError"}} < set(dir(hitmdp_jax))
assert hitmdp_jax.__version__[0].isdigit()
assert issubclass(hitmdp_jax.UsageError, ValueError)
assert "brax/ant" in suite_names()
print([name for name in {HEAVY} if name in sys.modules])
"""
    assert output_of(script) == "[]\n"


FIRST = [  # what may be the first in a process that imports Brax
    "from hitmdp_jax.agents import MOPG",
    "from hitmdp_jax.cli.guard import work_of; work_of('training')",
    "from hitmdp_jax.envs.suites import find_suite as f; f('toy/').constructor('toy/turkey')",
]


# A process of its own for each of them, which has imported already what takes seconds beside Brax.
EACH = """
import os, sys
import distrax, orbax.checkpoint

assert not {"brax", "mujoco"} & set(sys.modules)
sys.modules["warp"] = None
for first in sys.argv[1:]:
    child = os.fork()
    if not child:
        exec(first)
        assert "mujoco.mjx" in sys.modules
        sys.exit()
    assert os.waitpid(child, 0)[1] == 0, first
"""


@pytest.mark.whole
def test_nothing_is_printed_where_warp_is_missing():
    """MJX prints two lines then, of which a user can make nothing."""
    assert output_of(EACH, *FIRST) == ""
