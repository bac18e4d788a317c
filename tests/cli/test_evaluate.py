"""`python -m hitmdp_jax evaluate` as a user runs it."""

import json
import shutil
import threading

import numpy as np
import pytest

from hitmdp_jax.cli.evaluate import append
from tests.cli.conftest import rows_of


@pytest.fixture
def evaluated(command):
    def run(*arguments):
        result = command("evaluate", *arguments)
        assert result.returncode == 0, result.stderr
        return result.stdout

    return run


@pytest.fixture
def run_dir(finished, tmp_path):
    return shutil.copytree(finished[0], tmp_path / "run")


def test_every_seed_is_scored_printed_and_written(evaluated, run_dir):
    before = len(rows_of(run_dir, "evaluations.csv"))
    rows = json.loads(evaluated(run_dir, "--episodes", "3", "--json"))
    assert [(row["seed"], row["episodes"], row["iteration"]) for row in rows] == [
        (3, 3, 4), (4, 3, 4)
    ]  # fmt: skip
    written = rows_of(run_dir, "evaluations.csv")[before:]
    np.testing.assert_allclose(
        [float(row["return"]) for row in written], [row["return"] for row in rows]
    )


def test_one_seed_of_one_checkpoint_in_gymnasium(evaluated, run_dir):
    arguments = ("--episodes", "1", "--seed", "4", "--engine", "gymnasium", "--checkpoint", "4")
    out = evaluated(run_dir, *arguments, "--deterministic")
    assert "gymnasium" in out
    assert "-" in out  # one episode has no standard error
    (row,) = rows_of(run_dir, "evaluations.csv")[-1:]
    assert (row["engine"], row["deterministic"], row["std_error"]) == ("gymnasium", "True", "")


def test_other_choices_of_options_are_scored_too(evaluated, run_dir):
    before = len(rows_of(run_dir, "evaluations.csv"))
    arguments = (run_dir, "--episodes", "2", "--seed", "4", "--choices")
    (row,) = json.loads(evaluated(*arguments, "--json"))
    assert row["own_choices"] == pytest.approx(row["return"])  # the same episodes
    assert row["worst_option"] <= row["best_option"]
    assert len(rows_of(run_dir, "evaluations.csv")) == before + 1
    assert "by what chooses the options" in evaluated(*arguments)


def test_the_columns_of_an_older_version_gain_those_that_it_did_not_have(tmp_path):
    (tmp_path / "evaluations.csv").write_text("iteration,seed,return\r\n1,3,5.0\r\n")
    append(tmp_path, [{"iteration": 2, "task": "hopper", "seed": 3, "return": 6.0}])
    assert [dict(row) for row in rows_of(tmp_path, "evaluations.csv")] == [
        {"iteration": "1", "task": "", "seed": "3", "return": "5.0"},
        {"iteration": "2", "task": "hopper", "seed": "3", "return": "6.0"},
    ]


def test_choices_need_an_engine_that_they_can_be_made_in(command, run_dir):
    result = command("evaluate", run_dir, "--choices", "--engine", "gymnasium")
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)
    assert result.stderr.startswith("error: --choices needs an engine of JAX")


def test_scores_that_two_write_at_once_are_all_kept(tmp_path):
    """A run scores its policies while its user does."""
    rows = [[{"iteration": 10 * i + j, "return": 1.0} for j in range(3)] for i in range(8)]
    threads = [threading.Thread(target=append, args=(tmp_path, own)) for own in rows]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    written = sorted(int(row["iteration"]) for row in rows_of(tmp_path, "evaluations.csv"))
    assert written == sorted(row["iteration"] for own in rows for row in own)
