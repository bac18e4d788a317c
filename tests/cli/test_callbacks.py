"""`callbacks=` and `stop_at_return=`, as a user sets them."""

import pytest

from hitmdp_jax.runs.checkpoint import saved_iterations
from hitmdp_jax.runs.run import Run
from tests.cli.conftest import QUICK, rows_of

OWN = """
from pathlib import Path

import hitmdp_jax
import jax
import numpy as np


class Largest(hitmdp_jax.Callback):
    every, names = 4096, ("largest",)

    def __call__(self, now):
        leaves = jax.tree.leaves(now.policy.params)
        leaves = [abs(x).reshape(len(x), -1).max(1) for x in leaves]
        return {"largest": np.max(leaves, axis=0)}

    def close(self):
        Path(__file__).with_name("closed").touch()


class Stops(hitmdp_jax.Callback):
    every = 4096

    def __call__(self, now):
        assert now.metrics["recent_return"].shape == (2,)
        now.stop("it has seen enough")


class Undeclared(hitmdp_jax.Callback):
    every = 1

    def __call__(self, now):
        return {"colour": 1.0}


class Asks(hitmdp_jax.Callback):
    def __init__(self, size): ...
    def __call__(self, now): ...


class Never(Largest):
    every = 0


class Taken(Largest):
    names = ("seed",)


class OneWord(Largest):
    names = "largest"


class Unwritten(hitmdp_jax.Callback): ...


class Stranger: ...
"""
SHORT = (*QUICK, "seeds=2", "total_steps=8192")


@pytest.fixture
def own(tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    return tmp_path / "own.py"


def test_a_callback_adds_a_metric_and_another_one_ends_the_run(command, own, tmp_path):
    run_dir = tmp_path / "run"
    both = f"callbacks=[{own}:Largest,{own}:Stops]"
    result = command("train", *SHORT, both, f"run_dir={run_dir}")
    assert result.returncode == 0, result.stderr
    assert f"Stopped at 4,096 env steps, as it has seen enough, saved in {run_dir}." in (
        result.stdout.splitlines()
    )
    rows = rows_of(run_dir)
    assert [row["env_steps"] for row in rows] == ["2048"] * 2 + ["4096"] * 2
    assert [row["largest"] for row in rows[:2]] == ["", ""]
    assert all(float(row["largest"]) > 0 for row in rows[2:])
    assert rows[2]["largest"] != rows[3]["largest"]
    assert (tmp_path / "closed").exists()
    # It is saved there, and goes on from there.
    saved = max(saved_iterations(run_dir))
    assert saved == int(rows[-1]["iteration"])
    again = command("train", f"resume={run_dir}", "report=false")
    assert again.returncode == 0, again.stderr
    assert f"Saved in {run_dir}." in again.stdout  # who stops a run at its end stops nothing
    assert rows_of(run_dir)[:4] == rows
    assert [row["env_steps"] for row in rows_of(run_dir)[4:]] == ["6144"] * 2 + ["8192"] * 2
    assert "is finished: 8,192 env steps" in command("train", f"resume={run_dir}").stdout


@pytest.mark.whole
def test_a_run_ends_at_its_return_and_goes_on_where_it_is_asked_to(command, tmp_path):
    run_dir = tmp_path / "run"
    result = command("train", *SHORT, "stop_at_return=-1e9", f"run_dir={run_dir}")
    assert result.returncode == 0, result.stderr
    assert "Stopped at 2,048 env steps, as the mean return of the last episodes reached" in (
        result.stdout
    )
    assert len(rows_of(run_dir)) == 2
    again = command("train", f"resume={run_dir}", "report=false")
    assert again.returncode == 0, again.stderr
    assert again.stdout == (
        f"{run_dir} has reached stop_at_return = -1e+09. "
        "A higher one goes on, and so does stop_at_return=null.\n"
    )
    assert len(rows_of(run_dir)) == 2
    again = command("train", f"resume={run_dir}", "report=false", "stop_at_return=-1e8")
    assert "has reached stop_at_return = -1e+08" in again.stdout
    again = command("train", f"resume={run_dir}", "report=false", "stop_at_return=null")
    assert f"Saved in {run_dir}." in again.stdout
    assert len(rows_of(run_dir)) == 8
    never = command("train", *SHORT, "stop_at_return=1e9", f"run_dir={tmp_path / 'other'}")
    assert f"Saved in {tmp_path / 'other'}." in never.stdout
    assert len(rows_of(tmp_path / "other")) == 8


@pytest.mark.parametrize(("name", "sentence"), [
    ("Asks", "is made without arguments, and asks for size."),
    ("Never", "every of callbacks: own.Never = 0"),
    ("Taken", "'seed' has the name of a run's own"),
    ("OneWord", "a tuple of words"),
    ("Unwritten", "is abstract: it still needs __call__."),
    ("Stranger", "derive it from hitmdp_jax.Callback."),
    ("Larges", "did you mean 'Largest'?"),
    ("Largest,{own}:Largest", "have the metric 'largest' twice"),
])  # fmt: skip
def test_a_class_that_is_no_callback_is_told_before_anything_is_traced(
    name, sentence, command, own, tmp_path, monkeypatch
):
    monkeypatch.delattr(Run, "create")
    given = f"callbacks=[{own}:{name.format(own=own)}]"
    result = command("train", *SHORT, given, f"run_dir={tmp_path / 'run'}")
    assert result.returncode == 2, result.stderr
    assert sentence in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_a_metric_that_is_not_listed_is_told_and_what_was_learned_is_kept(command, own, tmp_path):
    given = f"callbacks={own}:Undeclared"
    result = command("train", *SHORT, given, f"run_dir={tmp_path / 'run'}")
    assert result.returncode == 2
    assert "Undeclared returned a metric 'colour' that its `names` do not list." in result.stderr
    assert saved_iterations(tmp_path / "run")


@pytest.mark.parametrize("trusted", [False, True])
@pytest.mark.whole
def test_a_strangers_callbacks_are_run_by_nobody_who_does_not_trust_them(
    trusted, command, own, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr("hitmdp_jax.plugins._trusted", set())
    run_dir, marker = tmp_path / "run", tmp_path / "marker"
    assert command("train", *SHORT, f"run_dir={run_dir}").returncode == 0
    planted = tmp_path / "planted.py"
    planted.write_text(f"open({str(marker)!r}, 'w')\n" + OWN)
    config = (run_dir / "config.yaml").read_text()
    assert "callbacks: null" in config
    config = config.replace("callbacks: null", f"callbacks: ['{planted}:Largest']")
    config = config.replace("total_steps: 8192", "total_steps: 12288")
    (run_dir / "config.yaml").write_text(config)
    trust = ["trust=true"] if trusted else []
    result = command("train", f"resume={run_dir}", "report=false", *trust)
    assert result.returncode == (0 if trusted else 2), result.stderr
    assert marker.exists() == trusted
    if not trusted:
        assert f"'{planted}' would be executed" in result.stderr
        assert command("evaluate", run_dir, "--episodes", "2").returncode == 0
        assert not marker.exists()
