"""Two processes on this machine that train one run, as a user starts them by hand."""

import os
import signal
import socket
import subprocess
import sys
import time

import jax
import numpy as np
import pytest

from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs import processes
from hitmdp_jax.runs.checkpoint import Checkpoints, saved_iterations
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.run import Run
from tests.cli.conftest import CHECKOUT, QUICK, command, rows_of, variables, wait_for_rows
from tests.signals import signals_heard

__all__ = ["command", "variables"]  # fixtures

LONG = ("total_steps=1e8", "checkpoint_steps=8192")


@pytest.fixture
def start_two(variables, tmp_path):
    """Start `python -m hitmdp_jax train distributed=true ...` twice, in folders of their own."""
    started = []

    def begin(*arguments, folder=tmp_path, **environment):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            address = f"127.0.0.1:{free.getsockname()[1]}"
        common = {"JAX_COORDINATOR_ADDRESS": address, "JAX_NUM_PROCESSES": "2"} | environment
        pair = []
        for number in range(2):
            here = folder / f"process_{number}"
            here.mkdir(exist_ok=True)
            with signals_heard():
                pair.append(
                    subprocess.Popen(
                        [
                            sys.executable,
                            "-m",
                            "hitmdp_jax",
                            "train",
                            "distributed=true",
                            *arguments,
                        ],
                        cwd=here,
                        env=os.environ | variables | common | {"JAX_PROCESS_ID": str(number)},
                        stdout=subprocess.PIPE,
                        stderr=subprocess.PIPE,
                        text=True,
                    )
                )
        started.extend(pair)
        return pair

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def ends(pair):
    """Wait for both; return their exit codes, and what they printed."""
    told = [process.communicate() for process in pair]
    return [process.returncode for process in pair], told


def said(told):
    """What both printed, as a text: pytest shortens the repr of anything else."""
    return "\n".join(text for of_one in told for text in of_one)


def state_of(run_dir):
    checkpoints = Checkpoints(run_dir, read_only=True)
    try:
        state = Run.create(RunConfig.load(run_dir)).restore(checkpoints).state
    finally:
        checkpoints.close()
    return jax.device_get(state.replace(key=jax.random.key_data(state.key)))


def assert_alike(one, other):
    for x, y in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-4)


def assert_alone_ends_alike(command, together, *settings):
    """One process that trains as far, at once, comes to the same."""
    alone = together.with_name("alone")
    steps = int(rows_of(together)[-1]["env_steps"])
    one = command("train", *QUICK, *settings, f"total_steps={steps}", f"run_dir={alone}")
    assert one.returncode == 0, one.stderr
    rows = [rows_of(folder) for folder in (together, alone)]
    for name in ("iteration", "seed", "recent_return", "action_entropy"):
        np.testing.assert_allclose(*([float(r[name]) for r in x] for x in rows), rtol=1e-3)
    assert_alike(state_of(together), state_of(alone))


@pytest.mark.whole
def test_two_processes_stop_together_and_one_goes_on_as_it_would_alone(
    start_two, command, tmp_path
):
    """A signal to one stops both after the same iteration; the first one alone leaves anything."""
    run_dir = tmp_path / "together"
    pair = start_two(*QUICK, *LONG, "data_devices=2", f"run_dir={run_dir}")
    wait_for_rows(run_dir, 3, pair[0])
    pair[1].send_signal(signal.SIGTERM)
    codes, told = ends(pair)
    assert codes == [143, 143], said(told)
    assert "in 2 processes" in told[0][0]
    assert f"saved in {run_dir}" in told[0][0]
    others = [line for line in told[1][0].splitlines() if not line.startswith("[Gloo]")]
    assert others == []
    assert not list((tmp_path / "process_1").iterdir())
    last = int(rows_of(run_dir)[-1]["iteration"])
    assert max(saved_iterations(run_dir)) == last

    again = command(
        "train", f"resume={run_dir}", f"total_steps={(last + 1) * 2048}", "report=false"
    )
    assert again.returncode == 0, again.stderr
    assert_alone_ends_alike(command, run_dir)


@pytest.mark.slow
@pytest.mark.parametrize("settings", [["seeds=2"], ["data_devices=2"]])
def test_two_processes_go_on_together_as_one_trains(start_two, command, tmp_path, settings):
    run_dir = tmp_path / "together"
    begun = start_two(*QUICK, *settings, "total_steps=4096", f"run_dir={run_dir}")
    assert ends(begun)[0] == [0, 0]
    codes, told = ends(start_two(f"resume={run_dir}", "total_steps=8192", "report=false"))
    assert codes == [0, 0], said(told)
    alone = [] if "data_devices=2" in settings else settings
    assert_alone_ends_alike(command, run_dir, *alone)


@pytest.mark.slow
@pytest.mark.parametrize("killed", [0, 1])
def test_a_killed_process_ends_the_other_and_the_run_goes_on_alone(
    start_two, command, tmp_path, killed
):
    run_dir = tmp_path / "run"
    pair = start_two(*QUICK, *LONG, "seeds=2", f"run_dir={run_dir}")
    while not saved_iterations(run_dir):
        assert pair[0].poll() is None, pair[0].communicate()
        time.sleep(0.1)
    pair[killed].kill()
    codes, told = ends(pair)
    assert codes[killed] == -signal.SIGKILL
    assert codes[1 - killed] == 1, said(told)
    assert "another one has gone: resume= with the run folder goes on" in told[1 - killed][1]
    saved = max(saved_iterations(run_dir))
    steps = (saved + 1) * 2048
    again = command("train", f"resume={run_dir}", f"total_steps={steps}", "report=false")
    assert again.returncode == 0, again.stderr
    assert int(rows_of(run_dir)[-1]["iteration"]) == saved + 1


@pytest.mark.slow
def test_what_one_finds_wrong_both_end_for(start_two, tmp_path):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "config.yaml").write_text("")
    codes, told = ends(start_two(*QUICK, "seeds=2", f"run_dir={tmp_path / 'taken'}"))
    assert codes == [2, 2], said(told)
    assert "already holds a run" in told[0][1]
    assert told[1][1] == ""


@pytest.mark.slow
def test_more_processes_than_work_are_refused(start_two):
    codes, told = ends(start_two(*QUICK))
    assert codes == [2, 2], said(told)
    assert "2 processes are more than the 1 devices that the run takes; give seeds=2" in told[0][1]


@pytest.mark.parametrize(
    ("variables", "part"),
    [
        ({"JAX_NUM_PROCESSES": "two"}, "JAX_NUM_PROCESSES = two must be a whole number"),
        ({"JAX_COORDINATOR_ADDRESS": "here"}, "JAX_COORDINATOR_ADDRESS = here must be a host and"),
    ],
)
def test_variables_that_are_wrong_are_refused(monkeypatch, variables, part):
    for name, text in variables.items():
        monkeypatch.setenv(name, text)
    with pytest.raises(UsageError, match=part):
        processes.join()


def test_variables_that_tell_of_no_processes_are_refused():
    """In a process in which nothing was computed, and which imports little."""
    command = [sys.executable, "-c", "from hitmdp_jax.runs.processes import join; join()"]
    environment = os.environ | {"PYTHONPATH": str(CHECKOUT)}
    out = subprocess.run(command, env=environment, capture_output=True, text=True)
    last = out.stderr.splitlines()[-1]
    assert "UsageError: distributed=true finds no other processes" in last
