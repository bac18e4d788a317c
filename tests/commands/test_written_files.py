"""What each command writes into a run's folder: through no link, and whole or not at all."""

import errno
import fnmatch
import os
import shutil

import pytest

from hitmdp_jax.commands import report
from hitmdp_jax.training import folder
from tests.commands.conftest import rows_of
from tests.training.test_folder import contents, plant

EVALUATE = ("evaluate", "{}", "--episodes=2")
REPORT = ("report", "{}")
EXPORT = ("export", "{}", "--format=stablehlo")
VIDEO = ("video", "{}", "--episodes=1")
DRAW = ("reproduce", "figure6", "{}")
RESUME = ("train", "resume={}", "total_steps=10240", "report=false")
EXPORTED = f"{folder.EXPORT}/policy_8192.stablehlo"
FILMED = f"{folder.VIDEOS}/8192"
DRAWN = f"{folder.FIGURES}/figure6.png"
CURVE = f"{folder.FIGURES}/learning_curve.png"
LINKS = [
    (EVALUATE, folder.EVALUATIONS),
    (REPORT, folder.REPORT),
    *((EXPORT, name) for name in (folder.EXPORT, EXPORTED, f"{EXPORTED}.json")),
    *((VIDEO, name) for name in (folder.VIDEOS, f"{FILMED}.mp4")),
    *((DRAW, name) for name in (folder.FIGURES, DRAWN)),
    *((RESUME, name) for name in (folder.METRICS, CURVE)),
]
FILES = [
    *((line, name) for line, name in LINKS if name not in folder.FOLDERS),
    (VIDEO, f"{FILMED}.png"),
    *((RESUME, name) for name in (folder.CONFIG, folder.MADE_WITH)),
]


@pytest.fixture
def run_dir(finished, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "report", lambda *args: "a page")
    return shutil.copytree(finished[0], tmp_path / "run")


def filled(line, run_dir):
    return [part.format(run_dir) for part in line]


@pytest.mark.parametrize(("line", "name"), LINKS)
def test_a_command_writes_through_no_link(command, run_dir, tmp_path, line, name):
    elsewhere = tmp_path / "elsewhere"
    before = plant(run_dir / name, elsewhere)
    result = command(*filled(line, run_dir))
    assert contents(elsewhere) == before
    assert (run_dir / name).is_symlink()
    assert "nothing is written through one" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(("line", "name"), FILES)
def test_a_full_disk_leaves_the_old_file(command, run_dir, monkeypatch, line, name):
    """The disk is full when the file is written, which another command line wrote before."""
    path, fsync = run_dir / name, os.fsync
    path.parent.mkdir(exist_ok=True)
    if not path.exists():
        path.write_text("old")
    if name == folder.MADE_WITH:
        path.write_text("another machine")
    before = path.read_bytes()

    def full(file):
        if os.readlink(f"/proc/self/fd/{file}").startswith(f"{path.parent}/.{path.name}."):
            raise OSError(errno.ENOSPC, "No space left on device")
        fsync(file)

    monkeypatch.setattr(os, "fsync", full)
    result = command(*filled(line, run_dir))
    assert path.read_bytes() == before
    assert not list(path.parent.glob(".*.tmp"))
    assert "No space left on device" in result.stderr
    assert "Traceback" not in result.stderr
    if line == EVALUATE:  # the scores are printed all the same
        assert result.returncode == 0
        assert "std error" in result.stdout
    monkeypatch.setattr(os, "fsync", fsync)
    again = command(*filled(line, run_dir))
    assert again.returncode == 0, again.stderr
    if line == RESUME:
        assert len(rows_of(run_dir)) == 2 * 5


def test_whatever_commands_leave_is_on_the_list(command, run_dir):
    for line in (EVALUATE, REPORT, EXPORT, VIDEO, DRAW):
        result = command(*filled(line, run_dir))
        assert result.returncode == 0, result.stderr
    patterns = (folder.LOCK, *folder.FOLDERS, *folder.FILES)
    left = [path.name for path in run_dir.iterdir()]
    assert set(folder.FOLDERS) - set(left) == {folder.SETTINGS, folder.WANDB}
    assert [name for name in left if not any(fnmatch.fnmatch(name, p) for p in patterns)] == []
