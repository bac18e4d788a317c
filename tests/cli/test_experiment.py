"""`hitmdp experiment NAME ...` as a user runs it."""

import csv
import dataclasses
import json
import shutil
import signal
from pathlib import Path

import pytest
import yaml

from hitmdp_jax.cli import cells, published
from hitmdp_jax.cli.arms import configs_of
from hitmdp_jax.cli.published import Places
from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments import experiment
from hitmdp_jax.runs.checkpoint import saved_iterations
from tests.cli.conftest import CHECKOUT, QUICK, SMALL, rows_of, signal_after_rows
from tests.report.shown import charts


@pytest.mark.parametrize("name", sorted({*experiment.names()} - {"compare"}))
def test_every_cell_of_the_catalogue_can_be_run_and_the_paper_speaks_of_no_other(name):
    read = experiment.read(name)
    tasks = read.tasks or {"": []}
    whole = dataclasses.replace(read, tasks=tasks)
    # Each task under one arm and each arm on one task: composing every pair takes a quarter minute.
    (task, *_), (arm, *_) = tasks, read.arms
    cells = {(t, arm) for t in tasks} | {(task, a) for a in read.arms}
    configs = configs_of({f"{t}/{a}": whole.settings_of(t, a) for t, a in cells})
    assert all(config.seeds >= 10 for config in configs.values())
    usual = dict(text.split("=", 1) for text in read.settings)["total_steps"]
    for t in tasks:  # its own number of steps, where it names one
        own = dict(text.split("=", 1) for text in tasks[t])
        assert configs[f"{t}/{arm}"].total_steps == int(own.get("total_steps", usual))
    assert set(read.paper) <= set(read.arms)
    assert {t for tasks in read.paper.values() for t in tasks} <= set(read.tasks)


def test_settings_of_the_arm_count_before_those_of_the_task_and_of_every_run():
    own = experiment.Experiment(
        "?", {"arm": ["seed=1"]}, {"task": ["seed=2", "seeds=2"]}, ["seed=3", "seeds=3", "x=3"]
    )
    assert own.settings_of("task", "arm") == ["seed=1", "seeds=2", "x=3"]
    assert own.settings_of("task", "arm", ["x=0"]) == ["seed=1", "seeds=2", "x=0"]


def test_a_task_that_cannot_be_read_costs_no_figure(tmp_path):
    places = Places(tmp_path / "results", tmp_path / "results.md")
    task = places.results / "hopper"
    shutil.copytree(CHECKOUT / "results" / "hopper", task)
    published.tell({}, places)
    figure, told = (places.results / "table2.png").read_bytes(), places.page.read_text()
    (task / "runs.yaml").write_text("mopg: {config: {nonsense: 1}}\n")
    with pytest.raises(UsageError, match="nonsense"):
        published.tell({}, places)
    assert (places.results / "table2.png").read_bytes() == figure
    assert places.page.read_text() == told
    shutil.rmtree(task)
    published.tell({}, places)
    assert not (places.results / "table2.png").exists()  # nothing is left to draw


@pytest.fixture
def scored_here(command, monkeypatch):
    """Score arms in this process; that of an own experiment, below, has one of its own."""

    def evaluate(run_dir, *flags):
        result = command("evaluate", run_dir, "--json", "--trust", *flags, cwd=Path.cwd())
        assert result.returncode == 0, result.stderr
        return json.loads(result.stdout)

    monkeypatch.setattr(cells, "_evaluate", evaluate)


@pytest.mark.usefixtures("arms_here", "scored_here")
@pytest.mark.whole
def test_a_table_is_trained_published_and_not_trained_again(command, tmp_path):
    part = ["tasks=invertedpendulum", "arms=mopg", *SMALL, "total_steps=2048", "seeds=2"]
    arguments = ["table2", *part]
    result = command("experiment", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    told = (tmp_path / "docs" / "results.md").read_text()
    assert "| mopg | 2 |" in told
    assert "Not run: walker2d (mopg, mopg-printed, ppo, dac" in told
    assert "python train.py physics=native total_steps=2048 seeds=2 seed=100 env=inv" in told
    folder = tmp_path / "results" / "invertedpendulum"
    seeds = folder / "seeds.csv"
    header, first, _ = seeds.read_text().splitlines()
    assert header.startswith("arm,seed,env_steps,last_20_episodes,last_100k_steps,options_used,")
    assert first.startswith("mopg,100,2048,")
    assert header.endswith(",best_option,worst_option")
    assert (folder / "mopg.policy").is_file()
    before = seeds.stat().st_mtime_ns
    (tmp_path / "docs" / "results.md").unlink()
    again = command("experiment", *arguments[:-1], "seeds=1", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert seeds.stat().st_mtime_ns == before
    # Two more, so that these are two again: a program of another number is another to compile.
    more = command("experiment", *arguments[:-1], "seeds=4", cwd=tmp_path)
    assert more.returncode == 0, more.stderr
    assert seeds.read_text().splitlines()[:2] == [header, first]
    assert seeds.read_text().splitlines()[3].startswith("mopg,102,")
    told = (tmp_path / "docs" / "results.md").read_text()
    assert "| mopg | 4 |" in told
    assert "seeds=2 seed=100" in told
    assert "seeds=2 seed=102" in told
    written = command("experiment", "results", cwd=tmp_path)
    assert written.returncode == 0, written.stderr
    assert (tmp_path / "docs" / "results.md").read_text() == told
    assert (tmp_path / "results" / "table2.png").is_file()
    assert "(../results/table2.png)" in told
    drawn = command("experiment", "curves", cwd=tmp_path)
    assert drawn.returncode == 0, drawn.stderr
    drawn_page = (tmp_path / "results.html").read_text()
    assert any("mopg, seed 101" in told for told in charts(drawn_page))
    other = command("experiment", *arguments, "algo.gamma=0.9", cwd=tmp_path)
    assert other.returncode == 2
    assert "was published with other settings (algo.gamma: 0.9 here, 0.99 there)" in other.stderr


@pytest.mark.whole
def test_an_experiment_of_ones_own_is_trained_and_told_on_its_page(
    command, tmp_path, arms_here, monkeypatch, request
):
    """Its arms are trained in this process. The first is scored in a process of its own."""
    in_another_process = cells._evaluate
    request.getfixturevalue("scored_here")
    in_this_process, scored = cells._evaluate, []

    def evaluate(run_dir, *flags):
        scored.append(run_dir)
        return (in_this_process if scored[1:] else in_another_process)(run_dir, *flags)

    monkeypatch.setattr(cells, "_evaluate", evaluate)
    own = {
        "title": "Does discounting matter?",
        "control": "long",
        "settings": [*QUICK, "total_steps=2048", "seed=5"],
        "arms": {"long": [], "short, 10 steps": ["algo.gamma=0.9"]},
    }
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(own))
    # A setting of the command line counts before the experiment's own.
    result = command("experiment", "own.yaml", "seed=3", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert len(arms_here) == 2
    seeds = tmp_path / "runs/experiments/own/results/invertedpendulum/seeds.csv"
    assert [row["seed"] for row in csv.DictReader(seeds.open())] == ["3", "3"]
    page = (tmp_path / "runs" / "experiments" / "own" / "results.md").read_text()
    assert "## Does discounting matter?" in page
    assert "### invertedpendulum" in page
    assert "| short, 10 steps | 1 |" in page
    assert "minus long" in page
    again = command("experiment", "own.yaml", "arms=long", "page=page.md", "seed=3", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert len(arms_here) == 2  # nothing is trained again
    assert "short" not in again.stdout


COMPARE = ("compare", "arms=ppo", *(x for x in QUICK if x != "algo=ppo"))


@pytest.mark.whole
def test_ctrl_c_reaches_the_training_which_saves_and_goes_on_later(command, tmp_path):
    settings = (*COMPARE, "total_steps=400_000", f"run_dir={tmp_path}")
    run_dir = tmp_path / "invertedpendulum" / "ppo-0-1"
    with signal_after_rows(signal.SIGINT, run_dir):
        result = command("experiment", *settings)
    assert result.returncode == 130, result.stderr
    assert f"Stopped in {run_dir}. The same command continues from there." in result.stdout
    (saved,) = saved_iterations(run_dir)
    rows = rows_of(run_dir)
    assert int(rows[-1]["iteration"]) == saved
    other = command("experiment", *settings, "algo.gamma=0.9")
    assert other.returncode == 2
    assert "holds a run with other settings (algo.gamma: 0.9 here, 0.99 there)" in other.stderr
