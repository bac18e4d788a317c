"""What each command writes, of a run and of what is published: through no link, and whole."""

import csv
import dataclasses
import errno
import fnmatch
import functools
import os
import shutil

import numpy as np
import orbax.checkpoint as ocp
import pytest

from hitmdp_jax.cli import export, figure, report, reproduce, study, suites, video
from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments import results, sweeps
from hitmdp_jax.figures import theorems
from hitmdp_jax.runs import folder
from hitmdp_jax.runs.config import RunConfig
from tests.cli.conftest import CHECKOUT, rows_of
from tests.runs.test_folder import contents, plant
from tests.test_reading import CELL, UNREAD

EVALUATE = ("evaluate", "{}", "--episodes=2")
REPORT = ("report", "{}")
EXPORT = ("export", "{}", "--format=stablehlo")
VIDEO = ("video", "{}", "--episodes=1")
DRAW = ("figure", "figure6", "{}")
RESUME = ("train", "resume={}", "total_steps=10240", "report=false")
PAGE, CURVES = ("reproduce", "results"), ("reproduce", "curves")
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


def full(*args, **kwargs):
    raise OSError(errno.ENOSPC, "No space left on device")


def fill_disk(patch, path):
    """Let a file's writer find the disk full."""
    fsync = os.fsync

    def full_there(file):
        if os.readlink(f"/proc/self/fd/{file}").startswith(f"{path.parent}/.{path.name}."):
            full()
        fsync(file)

    patch.setattr(os, "fsync", full_there)


@pytest.fixture
def swept(finished, tmp_path):
    """The finished run as one of two settings instead of two seeds."""
    run_dir = shutil.copytree(finished[0], tmp_path / "run")
    sweep = {"algo.gamma": [0.9, 0.99]}
    config = dataclasses.replace(RunConfig.load(run_dir), seeds=1, sweep=sweep)
    (run_dir / folder.CONFIG).write_text(config.to_yaml())
    rows = rows_of(run_dir)
    for row in rows:
        row |= config.trainings[int(row["seed"]) - config.seed].columns
    with (run_dir / folder.METRICS).open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return run_dir


@pytest.mark.parametrize(("line", "name"), LINKS)
def test_a_command_writes_through_no_link(command, run_dir, tmp_path, line, name):
    elsewhere = tmp_path / "elsewhere"
    before = plant(run_dir / name, elsewhere)
    result = command(*filled(line, run_dir))
    assert contents(elsewhere) == before
    assert (run_dir / name).is_symlink()
    assert "nothing is written through one" in result.stderr
    assert "Traceback" not in result.stderr


# What a command writes at its end -> what takes the time until then.
LATE = [
    (REPORT, folder.REPORT, (report, "report")),
    ((*REPORT, "{}/../run"), "../comparison.html", (report, "_named")),
    *((EXPORT, name, (export, "export")) for name in (EXPORTED, f"{EXPORTED}.json")),
    *((VIDEO, f"{FILMED}.{kind}", (video, "run_episodes")) for kind in ("mp4", "png")),
    (DRAW, DRAWN, (figure, "metrics_of")),
    (("figure", "causal", "{}"), f"{folder.FIGURES}/causal.png", (figure, "analysis_of")),
    (("figure", "variance", "--out={}/a.png"), "a.png", (theorems, "sample_models")),
    (("reproduce", "compare", "run_dir={}"), "comparison.png", (reproduce, "train_arms")),
    (("study", "memory", "run_dir={}"), "study.md", (study, "train_arms")),
    (("study", "memory", "append={}/notes.md"), "notes.md", (study, "train_arms")),
]


@pytest.mark.parametrize(("line", "name", "work"), LATE)
def test_what_cannot_be_written_is_told_before_the_work(
    command, run_dir, monkeypatch, line, name, work
):
    (run_dir / name).mkdir(parents=True)
    monkeypatch.setattr(*work, lambda *args, **kwargs: pytest.fail("it was computed first"))
    result = command(*filled(line, run_dir), cwd=run_dir.parent)
    assert result.returncode == 2
    assert "it is not a file" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(("line", "name"), FILES)
def test_a_full_disk_leaves_the_old_file(command, run_dir, monkeypatch, line, name):
    """The disk is full when the file is written, which another command line wrote before."""
    path = run_dir / name
    path.parent.mkdir(exist_ok=True)
    if not path.exists():
        path.write_text("old")
    if name == folder.MADE_WITH:
        path.write_text("another machine")
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        fill_disk(patch, path)
        result = command(*filled(line, run_dir))
    assert path.read_bytes() == before
    assert not list(path.parent.glob(".*.tmp"))
    assert "No space left on device" in result.stderr
    assert "Traceback" not in result.stderr
    if line == EVALUATE:  # the scores are printed all the same
        assert result.returncode == 0
        assert "std error" in result.stdout
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


def test_what_nothing_reads_may_be_damaged(command, run_dir):
    for name in UNREAD:
        if name in folder.FOLDERS:
            (run_dir / name).mkdir(exist_ok=True)
            (run_dir / name / "more").touch()
        else:
            (run_dir / name.replace("*", "x")).touch()
        for path in run_dir.glob(name):
            for damaged in [path] if path.is_file() else filter(os.path.isfile, path.rglob("*")):
                damaged.write_bytes(bytes(range(256)))
    for line in (EVALUATE, RESUME):
        result = command(*filled(line, run_dir))
        assert (result.returncode, result.stderr) == (0, "")
    assert len(rows_of(run_dir)) == 2 * 5


@pytest.mark.parametrize("name", ["sweep.csv", "sweep.md", "figures/sweep.png", CURVE])
def test_a_full_disk_leaves_what_was_told_of_a_sweep(swept, monkeypatch, name):
    path = swept / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("old")
    with monkeypatch.context() as patch:
        fill_disk(patch, path)
        with pytest.raises(OSError, match="No space left on device") as raised:
            sweeps.draw_sweep(swept, RunConfig.load(swept))
    assert raised.value.filename == str(path)
    assert path.read_text() == "old"
    assert not list(swept.rglob(".*.tmp"))
    sweeps.draw_sweep(swept, RunConfig.load(swept))
    assert path.read_bytes() != b"old"


def test_a_full_disk_leaves_the_published_cell(swept, tmp_path, monkeypatch):
    """Whichever of its files is being written."""
    cell = tmp_path / "results" / "invertedpendulum" / "mopg"
    more = functools.partial(suites.publish_more, swept, with_policy=True)

    def publish(day):
        scores = {"evaluation": np.array([1.0, 2.0])}
        results.publish(swept, cell, scores, {"day": day}, None, more)

    publish("old")
    assert {path.name for path in cell.iterdir()} == set(CELL)
    before = contents(cell)
    for name in (*CELL, f"policy/{folder.CONFIG}"):
        with monkeypatch.context() as patch:
            if name == results.POLICY:  # whose numbers Orbax writes
                patch.setattr(ocp.CheckpointManager, "save", full)
            else:
                fill_disk(patch, cell.with_name(".mopg.new") / name)
            with pytest.raises((OSError, UsageError), match="No space left on device"):
                publish("new")
        assert contents(cell) == before
    publish("new")
    assert [path.name for path in cell.parent.iterdir()] == ["mopg"]
    assert {path.name for path in cell.iterdir()} == set(CELL)
    assert "new" in (cell / results.ABOUT).read_text()


@pytest.mark.parametrize(
    ("line", "name"),
    [(PAGE, "docs/results.md"), (PAGE, "results/table2.png"), (CURVES, "results.html")],
)
def test_a_full_disk_leaves_the_page_of_what_is_published(
    command, tmp_path, monkeypatch, line, name
):
    cell = "results/hopper/ppo"
    shutil.copytree(CHECKOUT / cell, tmp_path / cell)
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("old")
    with monkeypatch.context() as patch:
        fill_disk(patch, path)
        result = command(*line, cwd=tmp_path)
    assert result.returncode == 2
    assert "No space left on device" in result.stderr
    assert "Traceback" not in result.stderr
    assert path.read_text() == "old"
    assert not list(tmp_path.rglob(".*.tmp"))
    again = command(*line, cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert path.read_bytes() != b"old"
