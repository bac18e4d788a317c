import dataclasses
import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hitmdp_jax.agents import PPO
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.checkpoint import Checkpoints, Progress
from hitmdp_jax.runs.claim import (
    already_there,
    claim,
    default_folder,
    is_finished,
    locked,
    newest,
)
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import LOCK
from tests.probes import untrained

CONFIG = RunConfig(algo={"name": "ppo"}, env={"name": "halfcheetah"}, total_steps=4096)


def test_a_folder_is_claimed_once(tmp_path):
    run_dir = claim(tmp_path / "run", CONFIG)
    assert RunConfig.load(run_dir) == CONFIG
    with pytest.raises(UsageError, match="already holds a run: resume="):
        claim(run_dir, CONFIG)
    written = "metrics.csv", "made_with.txt", "report.html", "report_walker2d.html"
    for name in (*written, "export/policy.onnx"):
        (run_dir / name).parent.mkdir(exist_ok=True)
        (run_dir / name).write_text("old")
    (run_dir / "notes.txt").write_text("the user's own")
    claim(run_dir, CONFIG, overwrite=True)
    assert {path.name for path in run_dir.iterdir()} == {"config.yaml", ".lock", "notes.txt"}
    assert (run_dir / "notes.txt").exists()


def test_a_start_that_fails_leaves_a_folder_that_can_be_used_again(tmp_path, monkeypatch):
    def full(file):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(UsageError, match="cannot be written: No space left on device"):
            claim(tmp_path / "run", CONFIG)
    assert RunConfig.load(claim(tmp_path / "run", CONFIG)) == CONFIG


def test_a_kill_while_a_run_is_cleared_leaves_one_that_can_be_cleared_again(tmp_path, monkeypatch):
    """The settings go last: a folder without them holds no run, and is nobody's to clear."""
    run_dir = claim(tmp_path / "run", CONFIG)
    (run_dir / "metrics.csv").write_text("old")
    (run_dir / "checkpoints").mkdir()
    for name in ("metrics.csv", "config.yaml"):

        def killed(path, name=name, remove=Path.unlink, **kwargs):
            if path.name == name:
                raise KeyboardInterrupt
            remove(path, **kwargs)

        with monkeypatch.context() as patch:
            patch.setattr(Path, "unlink", killed)
            with pytest.raises(KeyboardInterrupt):
                claim(run_dir, CONFIG, overwrite=True)
        assert RunConfig.load(run_dir) == CONFIG
    claim(run_dir, CONFIG, overwrite=True)
    assert {path.name for path in run_dir.iterdir()} == {"config.yaml", ".lock"}


def test_runs_of_the_same_second_get_folders_of_their_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hitmdp_jax.runs.claim.time.strftime", lambda _: "now")
    folders = [claim(None, CONFIG) for _ in range(3)]
    assert [f.name for f in folders] == ["now", "now_2", "now_3"]
    assert folders[0] == default_folder(CONFIG)


def test_an_own_class_gives_a_short_name():
    own = {"name": "/somewhere/my_task.py:MyTask"}
    folder = default_folder(RunConfig(algo={"name": "ppo"}, env=own))
    assert folder.parts[:3] == ("runs", "my_task.MyTask", "ppo")


# Takes a lock where nobody has it, and keeps it until it is killed. It imports nothing of ours,
# which would take seconds.
HOLD = """
import fcntl, sys
file = open(sys.argv[1], "ab")
fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
print("holds it", flush=True)
sys.stdin.read()
"""


def test_two_processes_do_not_write_into_one_folder(tmp_path):
    other = [sys.executable, "-c", HOLD, str(tmp_path / LOCK)]
    with locked(tmp_path):
        refused = subprocess.run(other, stdin=subprocess.DEVNULL, capture_output=True, text=True)
        assert "BlockingIOError" in refused.stderr
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(other, **pipes, text=True) as child:
        assert child.stdout.readline() == "holds it\n"
        busy = "being written by another process"
        with pytest.raises(UsageError, match=busy), locked(tmp_path):
            pass
        child.kill()  # whoever is killed lets go
    with locked(tmp_path):
        pass


def test_another_runs_folder_is_not_taken_for_ones_own(tmp_path):
    assert not already_there(tmp_path, CONFIG)
    claim(tmp_path, CONFIG)
    assert already_there(tmp_path, CONFIG)
    assert not is_finished(tmp_path, CONFIG.schedule)
    for iteration, finished in ((1, False), (2, True)):
        checkpoints = Checkpoints(tmp_path)
        checkpoints.save(Progress(iteration, 0, untrained(PPO(hidden_sizes=(2,)), 1)))
        checkpoints.close()
        assert is_finished(tmp_path, CONFIG.schedule) == finished
    (tmp_path / "checkpoints" / "2" / "progress" / "metadata").write_text("")
    assert not is_finished(tmp_path, CONFIG.schedule)
    other = RunConfig(algo={"name": "ppo", "gamma": 0.9}, env={"name": "halfcheetah"}, seeds=2)
    with pytest.raises(UsageError, match=r"algo.gamma: 0.9 here, 0.99 there; seeds: 2 here, 1 the"):
        already_there(tmp_path, other)


def test_a_keyword_that_an_older_run_did_not_have_yet_is_at_its_default(tmp_path):
    claim(tmp_path, CONFIG)
    env = {"name": "halfcheetah", "ctrl_cost_weight": 0.1, "hide_velocities": False}
    assert already_there(tmp_path, dataclasses.replace(CONFIG, env=env))
    other = dataclasses.replace(CONFIG, env=env | {"hide_velocities": True})
    with pytest.raises(UsageError, match=r"env.hide_velocities: True here, False there"):
        already_there(tmp_path, other)


def test_the_newest_run_is_found(tmp_path):
    with pytest.raises(UsageError, match="latest names no run"):
        newest(tmp_path)
    for run_dir in (tmp_path / "a" / "b", tmp_path / "c"):
        claim(run_dir, CONFIG)
        (run_dir / "checkpoints" / "1").mkdir(parents=True)
    claim(tmp_path / "d", CONFIG)  # of which "nothing to save" was said
    os.utime(tmp_path / "d" / "config.yaml", (3e9, 3e9))
    (tmp_path / "a" / "b" / "metrics.csv").write_text("")
    os.utime(tmp_path / "a" / "b" / "metrics.csv", (2e9, 2e9))
    assert newest(tmp_path) == tmp_path / "a" / "b"


def test_a_folder_that_cannot_be_made_is_explained(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "run"):
        with pytest.raises(UsageError, match=r"is not a folder|cannot be written"):
            claim(folder, CONFIG)
