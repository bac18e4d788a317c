"""What each command writes, of a run and of what is published: through no link, and whole."""

import csv
import dataclasses
import errno
import fnmatch
import os
import shutil

import numpy as np
import pytest

from hitmdp_jax.cli import cells, export, figure, report, video
from hitmdp_jax.experiments import published, sweeps
from hitmdp_jax.figures import theorems
from hitmdp_jax.runs import folder
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.saving import extract
from tests.cli.conftest import CHECKOUT, rows_of
from tests.experiments.test_published import cell_of
from tests.interpret.reports import made_up
from tests.runs.test_folder import contents, plant
from tests.test_reading import PUBLISHED, UNREAD

EVALUATE = ("evaluate", "{}", "--episodes=2")
REPORT = ("report", "{}")
EXPORT = ("export", "{}", "--format=stablehlo")
VIDEO = ("video", "{}", "--episodes=1")
DRAW = ("figure", "figure6", "{}")
RESUME = ("train", "resume={}", "total_steps=10240", "report=false")
PAGE, CURVES = ("experiment", "results"), ("experiment", "curves")
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
    (("experiment", "memory", "page={}/notes.md"), "notes.md", (cells, "train_into")),
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
@pytest.mark.whole
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
@pytest.mark.whole
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


@pytest.mark.whole
def test_a_full_disk_leaves_what_is_published_of_a_task(finished, tmp_path, monkeypatch):
    """Whichever of its files is being written."""
    folder_of_task = tmp_path / "results" / "swimmer"
    metrics = made_up(np.random.default_rng(2), seeds=2)

    def publish(day):
        def add_policy(beside):
            extract(finished[0], beside / "mopg.policy")

        published.publish(cell_of(metrics, day=day), folder_of_task, "mopg", add_policy)

    publish("old")
    assert {path.name for path in folder_of_task.iterdir()} == {*PUBLISHED}
    before = contents(folder_of_task)
    for name in PUBLISHED:
        with monkeypatch.context() as patch:
            fill_disk(patch, folder_of_task.with_name(".swimmer.new") / name)
            with pytest.raises(OSError, match="No space left on device"):
                publish("new")
        assert contents(folder_of_task) == before
    publish("new")
    assert [path.name for path in folder_of_task.parent.iterdir()] == ["swimmer"]
    assert {path.name for path in folder_of_task.iterdir()} == {*PUBLISHED}
    assert "new" in (folder_of_task / published.RUNS).read_text()


@pytest.mark.parametrize(
    ("line", "name"),
    [(PAGE, "docs/results.md"), (PAGE, "results/table2.png"), (CURVES, "results.html")],
)
@pytest.mark.whole
def test_a_full_disk_leaves_the_page_of_what_is_published(
    command, tmp_path, monkeypatch, line, name
):
    task = "results/hopper"
    shutil.copytree(CHECKOUT / task, tmp_path / task)
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
