"""`python -m hitmdp_jax reproduce` as a user runs it."""

import signal

import pytest

from hitmdp_jax.runs.checkpoint import saved_iterations
from tests.cli.conftest import QUICK, rows_of, signal_after_rows


@pytest.fixture(scope="module")
def compared(command, tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare") / "both"
    settings = [*COMPARE, f"run_dir={folder}"]
    result = command("reproduce", *settings)
    assert result.returncode == 0, result.stderr
    return folder, settings, result


COMPARE = ("compare", "algos=ppo", *(x for x in QUICK if x != "algo=ppo"), "total_steps=4096")


def test_a_comparison_writes_a_table_and_a_figure(compared):
    folder, _, result = compared
    assert {p.name for p in folder.iterdir()} >= {"ppo", "comparison.md", "comparison.csv"}
    assert (folder / "comparison.png").stat().st_size > 10_000
    assert "IQM" in result.stdout


def test_a_finished_comparison_trains_nothing_again(compared, command, arms_here):
    folder, settings, _ = compared
    before = (folder / "ppo" / "metrics.csv").read_bytes()
    again = command("reproduce", *settings)
    assert again.returncode == 0, again.stderr
    (ppo,) = arms_here
    assert f"{folder / 'ppo'} is finished: 4,096 env steps" in ppo.stdout
    assert (folder / "ppo" / "metrics.csv").read_bytes() == before


def test_a_run_of_other_settings_is_not_taken_for_this_one(compared, command):
    _, settings, _ = compared
    other = command("reproduce", *settings, "algo.gamma=0.9")
    assert other.returncode == 2
    assert "holds a run with other settings (algo.gamma: 0.9 here, 0.99 there)" in other.stderr


def test_ctrl_c_reaches_the_training_which_saves_and_goes_on_later(command, tmp_path):
    folder = tmp_path / "both"
    settings = (*COMPARE[:-1], "total_steps=400_000", f"run_dir={folder}")
    with signal_after_rows(signal.SIGINT, folder / "ppo"):
        result = command("reproduce", *settings)
    assert result.returncode == 130, result.stderr
    assert f"The same command with run_dir={folder} goes on" in result.stdout
    (saved,) = saved_iterations(folder / "ppo")
    rows = rows_of(folder / "ppo")
    assert int(rows[-1]["iteration"]) == saved
