"""`python -m hitmdp_jax evaluate` as a user runs it."""

import json
import os
import shutil
import threading

import numpy as np
import pytest
import yaml

import hitmdp_jax
from hitmdp_jax.agents import PPO
from hitmdp_jax.cli.evaluate import append
from tests.cli.conftest import rows_of
from tests.probes import untrained


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
    assert "by choice of options" in evaluated(*arguments)


def test_another_task_of_the_same_sizes(evaluated, run_dir, halved):
    """One that pays half as much for the same episodes."""
    arguments = ("--episodes", "2", "--json")
    own = json.loads(evaluated(run_dir, *arguments))
    other = json.loads(evaluated(run_dir, *arguments, "--env", halved))
    for one, half in zip(own, other, strict=True):
        assert half["return"] == pytest.approx(one["return"] / 2)
        assert half["length"] == one["length"]
    written = rows_of(run_dir, "evaluations.csv")[-4:]
    tasks = ["invertedpendulum", "invertedpendulum", "own.Halved", "own.Halved"]
    assert [row["task"] for row in written] == tasks


def test_a_run_saved_from_python_is_scored_on_a_task_that_is_named(evaluated, tmp_path):
    """As a run is whose settings name that task."""
    arguments = ("--episodes", "2", "--json")
    agent = PPO(hidden_sizes=(8,))
    hitmdp_jax.save(tmp_path / "saved", agent, untrained(agent, 2))
    rows = json.loads(evaluated(tmp_path / "saved", *arguments, "--env", "toy/turkey"))
    assert [row["task"] for row in rows] == ["toy/turkey"] * 2
    named = shutil.copytree(tmp_path / "saved", tmp_path / "named")
    settings = yaml.safe_load((named / "config.yaml").read_text())
    settings["env"] = {"name": "toy/turkey"}
    (named / "config.yaml").write_text(yaml.safe_dump(settings))
    assert json.loads(evaluated(named, *arguments)) == rows


def test_latest_is_the_newest_run(command, finished, tmp_path):
    for name, time in (("a", 2_000_000_000), ("b", 1_000_000_000)):
        shutil.copytree(finished[0], tmp_path / "runs" / name)
        for file in ("config.yaml", "metrics.csv"):
            os.utime(tmp_path / "runs" / name / file, (time, time))
    result = command("evaluate", "latest", "--episodes", "2", "--json", cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "latest is runs/a\n")
    assert len(json.loads(result.stdout)) == 2
    assert len(rows_of(tmp_path / "runs/a", "evaluations.csv")) == 6
    assert len(rows_of(tmp_path / "runs/b", "evaluations.csv")) == 4
    result = command("figure", "figure5", "latest", cwd=tmp_path)
    assert result.stdout == "runs/a/figures/figure5.png\n"


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
