"""What a run survives. The long proofs are marked slow; docs/reliability.md has their figures."""

import random
import shutil
import signal
import subprocess
import time

import numpy as np
import psutil
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from hitmdp_jax.runs.checkpoint import saved_iterations
from tests.cli.conftest import CHECKOUT, QUICK, rows_of, wait_for_rows
from tests.cli.test_train import assert_same_run

KILLS = 20


def is_writing(run_dir):
    """Return whether a checkpoint is being written at this moment."""
    folder = run_dir / "checkpoints"
    return folder.is_dir() and any("tmp" in path.name for path in folder.iterdir())


@pytest.mark.slow  # twenty starts of a process, each of which compiles
@pytest.mark.timeout(3000)
def test_a_run_killed_twenty_times_ends_as_if_it_had_not_been(start, command, tmp_path):
    settings = (*QUICK, "seeds=2", "total_steps=200_000", "checkpoint_steps=2048")
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert command("train", *settings, f"run_dir={whole}").returncode == 0
    chance, while_writing = random.Random(0), 0
    process = start("train", *settings, f"run_dir={killed}")
    for _ in range(KILLS):
        before = max(saved_iterations(killed), default=0)
        while max(saved_iterations(killed), default=0) <= before:
            assert process.poll() is None, process.communicate()
            time.sleep(0.02)
        time.sleep(chance.uniform(0.0, 3.0))
        if chance.random() < 0.5:
            while not is_writing(killed) and process.poll() is None:
                time.sleep(0.001)
        while_writing += is_writing(killed)
        process.kill()
        _, errors = process.communicate()
        assert "Traceback" not in errors
        process = start("train", f"resume={killed}", "report=false")
    _, errors = process.communicate()
    assert process.returncode == 0, errors
    print(f"{KILLS} kills, {while_writing} of them while a checkpoint was written")
    assert while_writing >= 5
    assert_same_run(whole, killed)
    steps = [[e.step for e in points(folder, "train/value")] for folder in (whole, killed)]
    assert steps[0] == steps[1]


def points(run_dir, name):
    return EventAccumulator(str(run_dir), size_guidance={"scalars": 0}).Reload().Scalars(name)


@pytest.mark.slow  # half an hour
@pytest.mark.timeout(2400)
def test_memory_and_handles_stay_flat_for_half_an_hour(start, tmp_path):
    run_dir = tmp_path / "run"
    settings = ("env=halfcheetah", "physics=native", "total_steps=1e9", "checkpoint_steps=20480")
    process = start("train", *settings, f"run_dir={run_dir}")
    wait_for_rows(run_dir, 3, process)
    watched, samples = psutil.Process(process.pid), []
    for _ in range(60):
        time.sleep(30)
        samples.append(
            (watched.memory_info().rss / 2**20, watched.num_fds(), watched.num_threads())
        )
    process.send_signal(signal.SIGTERM)
    process.communicate()
    memory, handles, threads = np.array(samples).T
    third = len(samples) // 3
    first, last = np.median(memory[:third]), np.median(memory[-third:])
    print(
        f"{len(rows_of(run_dir))} iterations; memory {first:.0f} MiB in the first ten minutes, "
        f"{last:.0f} in the last; handles {handles[0]:.0f} to {handles[-1]:.0f}, "
        f"threads {threads[0]:.0f} to {threads[-1]:.0f}"
    )
    assert last < 1.05 * first
    assert handles[-third:].max() <= handles[:third].max()
    assert threads[-third:].max() <= threads[:third].max()


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 6 MiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=6m", "tmpfs", str(folder)])
    if made.returncode:
        pytest.skip("only root may mount a small disk")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.whole
def test_a_full_disk_ends_nothing_that_was_saved(start, command, small_disk):
    """The disk fills up after the first checkpoints: the run goes on and says what it could not."""
    run_dir = small_disk / "run"
    settings = (*QUICK, "total_steps=20480", "checkpoint_steps=4096", f"run_dir={run_dir}")
    (small_disk / "ballast").write_bytes(b"\0" * (9 * 2**19))
    process = start("train", *settings)  # whose threads and libraries say what they say as well
    _, errors = process.communicate()
    assert process.returncode == 2, errors
    assert "The last state is not saved" in errors
    assert errors.count("could not be written") == 1
    assert "Traceback" not in errors
    kept = saved_iterations(run_dir)
    (small_disk / "ballast").unlink()
    again = command("train", f"resume={run_dir}", "report=false")
    assert again.returncode == 0, again.stderr
    assert kept == [] or max(saved_iterations(run_dir)) == 10
    assert len(rows_of(run_dir)) == 10


@pytest.mark.whole
def test_what_is_killed_before_its_first_checkpoint_starts_again(start, command, tmp_path):
    run_dir = tmp_path / "run"
    process = start("train", *QUICK, "total_steps=4096", f"run_dir={run_dir}")
    settings = run_dir / "config.yaml"
    while not (settings.exists() and settings.stat().st_size):
        time.sleep(0.05)
    process.kill()
    process.communicate()
    shutil.rmtree(run_dir / "checkpoints", ignore_errors=True)
    result = command("train", f"resume={run_dir}", "report=false")
    assert result.returncode == 0, result.stderr
    assert len(rows_of(run_dir)) == 2


def test_every_promise_names_the_tests_that_hold_it():
    lines = (CHECKOUT / "docs/reliability.md").read_text().splitlines()
    for row in [line for line in lines if line.startswith("| ")][2:]:
        told = row.split("|")[-2].removesuffix(", slow ").strip()
        for name in told.split(", "):
            assert list((CHECKOUT / "tests").rglob(name.strip("`").removeprefix("tests/"))), row
