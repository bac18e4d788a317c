import contextlib
import csv
import dataclasses
import functools
import io
import os
import subprocess
import sys
import threading
import time
import traceback
from pathlib import Path

import jax
import pytest

import hitmdp_jax.__main__
from hitmdp_jax.cli import arms, evaluate, export, figure, report, training, video
from hitmdp_jax.interpret import evaluation
from hitmdp_jax.runs import loop
from hitmdp_jax.runs.config import BESIDE_THE_POINT
from hitmdp_jax.runs.run import Run
from tests import probes
from tests.signals import signals_heard

WITH_A_HOST = (training, evaluate, video, export, report, figure)
CHECKOUT = Path(__file__).parents[2]
SMALL = tuple(f"algo.{name}={x}" for name, x in probes.QUICK["algo"].items() if name != "name")
SMALL += ("report=false",)
QUICK = ("env=invertedpendulum", "physics=native", "algo=ppo", *SMALL)
FINISHED = ("env=invertedpendulum", "physics=native", *SMALL, "seeds=2", "seed=3")
FINISHED += ("eval_every=4096", "eval_episodes=2")
HALVED = """
from hitmdp_jax.envs.suites.gym.inverted_pendulum import InvertedPendulum

class Halved(InvertedPendulum):
    def step(self, state, action):
        state = super().step(state, action)
        return state.replace(reward=state.reward / 2)
"""


@pytest.fixture(scope="package")
def variables(compilation_cache, tmp_path_factory):
    """The variables of a process of its own, which finds what is compiled, however quickly.

    It finds no Warp, as most users have none: MJX imports its kernels wherever they are, which
    takes as long as all other imports. Tests of `physics=warp` run in the tests' process.
    """
    no_warp = tmp_path_factory.mktemp("no_warp")
    (no_warp / "warp.py").write_text("raise ImportError('not installed')\n")
    minimum = "jax_persistent_cache_min_compile_time_secs"
    before = getattr(jax.config, minimum)
    jax.config.update(minimum, 0.0)
    yield {
        "JAX_COMPILATION_CACHE_DIR": str(jax.config.jax_compilation_cache_dir),
        minimum.upper(): "0",
        "PYTHONPATH": os.pathsep.join(map(str, [CHECKOUT, no_warp])),
        "COLUMNS": "200",
    }
    jax.config.update(minimum, before)


@pytest.fixture(scope="package")
def command(variables, tmp_path_factory):
    """Run `hitmdp <name> ...` to its end in an empty folder, or `cwd`.

    In this process: another one would take seconds to import what is imported here. Runs that
    differ in nothing that is compiled share a program, and so do policies that play one task.
    """
    folder = tmp_path_factory.mktemp("cwd")
    env = functools.cache(evaluation._env.__wrapped__)
    programs, compiled, known = Run.programs, loop.compiled, {}

    def shared(run, task):
        beside = {"seed", "total_steps", "init_from", "init_parts", *BESIDE_THE_POINT}
        alike = dict.fromkeys(beside - {"data_devices"}, 1)
        given = run.agent.traced_values()  # inputs of the program
        alike["algo"] = {name: x for name, x in run.config.algo.items() if name not in given}
        like = str(dataclasses.replace(run.config, **alike)), task
        return known.get(like) or known.setdefault(like, programs(run, task))

    def compiled_once(step, state):
        leaves, structure = jax.tree.flatten(state)
        like = step, structure, *((x.shape, x.dtype, x.sharding) for x in leaves)
        return known.get(like) or known.setdefault(like, compiled(step, state))

    def run(name, *arguments, cwd=folder):
        out, err = io.StringIO(), io.StringIO()
        with (
            pytest.MonkeyPatch.context() as patch,
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            patch.setattr(sys, "argv", ["hitmdp", name, *map(str, arguments)])
            patch.setattr(threading, "excepthook", threading.excepthook)
            # This process is set up already, as it can be only once.
            for module in WITH_A_HOST:
                patch.setattr(module, "set_up_host", lambda *args: None)
            for name_and_value in variables.items():
                patch.setenv(*name_and_value)
            patch.setattr(Run, "programs", shared)
            patch.setattr(loop, "compiled", compiled_once)
            patch.setattr(evaluation, "_env", env)
            patch.chdir(cwd)
            code = exit_code_of(hitmdp_jax.__main__.main)
        return subprocess.CompletedProcess(name, code, out.getvalue(), err.getvalue())

    return run


@pytest.fixture
def arms_here(command, monkeypatch):
    """Train arms in this process; the results of their trainings."""
    trained = []

    def train(settings):
        trained.append(command("train", *settings, cwd=Path.cwd()))
        return trained[-1].returncode

    monkeypatch.setattr(arms, "train", train)
    return trained


def exit_code_of(function):
    """Call a function as Python calls a program; return the exit code."""
    try:
        function()
    except SystemExit as stop:
        return stop.code or 0
    except Exception:
        traceback.print_exc()
        return 1
    return 0


@pytest.fixture
def start(variables, tmp_path):
    """Start `hitmdp <name> ...` and return the process."""
    processes = []

    def begin(name, *arguments, stdout=subprocess.PIPE):
        with signals_heard():
            process = subprocess.Popen(
                [sys.executable, "-m", "hitmdp_jax", name, *map(str, arguments)],
                cwd=tmp_path,
                env=os.environ | variables,
                stdout=stdout,
                stderr=subprocess.PIPE,
                text=True,
            )
        processes.append(process)
        return process

    yield begin
    for process in processes:
        with process:
            process.kill()


@pytest.fixture(scope="package")
def finished(command, tmp_path_factory):
    """A finished run of two seeds, 3 and 4; tests leave it as it is."""
    run_dir = tmp_path_factory.mktemp("runs") / "run"
    result = command("train", *FINISHED, "total_steps=8192", f"run_dir={run_dir}")
    assert result.returncode == 0, result.stderr
    return run_dir, result


@pytest.fixture
def halved(tmp_path):
    """A task that pays half of what the finished run's pays, for the same episodes."""
    (tmp_path / "own.py").write_text(HALVED)
    return tmp_path / "own.py:Halved"


def rows_of(run_dir, name="metrics.csv"):
    with (run_dir / name).open(newline="") as file:
        return list(csv.DictReader(file))


def wait_for_rows(run_dir, count, process=None):
    """Wait until a run that is under way, in a process where one is given, has written rows."""
    while not (run_dir / "metrics.csv").exists() or len(rows_of(run_dir)) < count:
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.05)


@contextlib.contextmanager
def signal_after_rows(signum, run_dir, count=3):
    """Send this process a signal once a run has written rows; whoever runs must handle it."""

    def send():
        wait_for_rows(run_dir, count)
        os.kill(os.getpid(), signum)

    with signals_heard():
        threading.Thread(target=send, daemon=True).start()
        yield
