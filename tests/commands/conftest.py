import csv
import os
import subprocess
import sys
import time
from pathlib import Path

import jax
import pytest

CHECKOUT = Path(__file__).parents[2]
QUICK = ("env=invertedpendulum", "physics=native", "algo=ppo", "algo.num_epochs=1")


@pytest.fixture(scope="session")
def environment(compilation_cache):
    """The variables of a command line in a process of its own, which finds what is compiled."""
    cache = str(jax.config.jax_compilation_cache_dir)
    variables = {"JAX_COMPILATION_CACHE_DIR": cache, "COLUMNS": "200", "PYTHONPATH": str(CHECKOUT)}
    return os.environ | variables


@pytest.fixture(scope="session")
def command(environment, tmp_path_factory):
    """Run `python -m hitmdp_jax.<name> ...` to its end in an empty folder, or `cwd`."""
    folder = tmp_path_factory.mktemp("cwd")

    def run(name, *arguments, cwd=folder, timeout=300, **variables):
        return subprocess.run(
            [sys.executable, "-m", f"hitmdp_jax.{name}", *map(str, arguments)],
            cwd=cwd,
            env=environment | variables,
            capture_output=True,
            text=True,
            timeout=timeout,
        )

    return run


@pytest.fixture
def start(environment, tmp_path):
    """Start `python -m hitmdp_jax.<name> ...` and return the process."""
    processes = []

    def begin(name, *arguments):
        process = subprocess.Popen(
            [sys.executable, "-m", f"hitmdp_jax.{name}", *map(str, arguments)],
            cwd=tmp_path,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        return process

    yield begin
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def finished(command, tmp_path_factory):
    """A finished run of two seeds, 3 and 4; tests leave it as it is."""
    run_dir = tmp_path_factory.mktemp("runs") / "run"
    mopg = ("env=invertedpendulum", "physics=native", "algo.num_epochs=1")
    sizes = ("seeds=2", "seed=3", "total_steps=8192", "eval_every=4096", "eval_episodes=2")
    result = command("train", *mopg, *sizes, f"run_dir={run_dir}")
    assert result.returncode == 0, result.stderr
    return run_dir, result


def rows_of(run_dir, name="metrics.csv"):
    with (run_dir / name).open(newline="") as file:
        return list(csv.DictReader(file))


def wait_for_rows(process, run_dir, count):
    """Wait until a run that is under way has written some rows."""
    while not (run_dir / "metrics.csv").exists() or len(rows_of(run_dir)) < count:
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
