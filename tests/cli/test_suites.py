"""`python -m hitmdp_jax reproduce table1` and its like, as a user runs them."""

import shutil

import jax
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.cli import suites
from hitmdp_jax.cli.arms import configs_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments.results_page import page
from tests.cli.conftest import CHECKOUT, SMALL


@pytest.mark.parametrize("name", suites.names())
def test_every_cell_of_a_suite_can_be_run_and_the_paper_speaks_of_no_other(name):
    suite = suites.read(name)
    # Each task under one arm and each arm on one task: composing every pair takes a quarter minute.
    (task, *_), (arm, *_) = suite.tasks, suite.arms
    cells = {(t, arm) for t in suite.tasks} | {(task, a) for a in suite.arms}
    configs = configs_of({f"{t}/{a}": suite.settings_of(t, a) for t, a in cells})
    assert all(config.seeds >= 10 for config in configs.values())
    for t in suite.tasks:  # its own number of steps, where it names one
        own = dict(text.split("=", 1) for text in suite.tasks[t])
        assert configs[f"{t}/{arm}"].total_steps == int(own.get("total_steps", 10**6))
    assert suite.control is None or suite.control in suite.arms
    assert set(suite.paper) <= set(suite.arms)
    assert {t for tasks in suite.paper.values() for t in tasks} <= set(suite.tasks)


def test_the_page_is_that_of_the_published_results():
    every = {name: suites.read(name) for name in suites.names()}
    written = page(every, CHECKOUT / "results", "../results")
    assert written == (CHECKOUT / "docs/results.md").read_text()


def test_a_cell_that_cannot_be_read_costs_no_figure(tmp_path):
    results, page_file = tmp_path / "results", tmp_path / "results.md"
    cell = results / "hopper" / "ppo"
    shutil.copytree(CHECKOUT / "results" / "hopper" / "ppo", cell)
    suites.tell(results, page_file)
    figure, told = (results / "table2.png").read_bytes(), page_file.read_text()
    (cell / "config.yaml").write_text("nonsense: 1\n")
    with pytest.raises(UsageError, match="nonsense"):
        suites.tell(results, page_file)
    assert (results / "table2.png").read_bytes() == figure
    assert page_file.read_text() == told
    shutil.rmtree(cell)
    suites.tell(results, page_file)
    assert not (results / "table2.png").exists()  # nothing is left to draw


def test_published_policies_are_small_and_can_be_loaded():
    folders = sorted((CHECKOUT / "results").glob("*/*/policy"))
    assert folders
    for folder in folders:
        assert sum(x.stat().st_size for x in folder.rglob("*") if x.is_file()) < 2 * 2**20
        policy = hitmdp_jax.load(folder)  # which has it act, on shapes
        assert all(np.isfinite(x).all() for x in jax.tree.leaves(policy.params))


def test_a_suite_is_trained_published_and_not_trained_again(command, tmp_path, arms_here):
    part = ["tasks=invertedpendulum", "arms=mopg", *SMALL, "total_steps=2048", "seeds=2"]
    arguments = ["table2", *part]
    result = command("reproduce", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    told = (tmp_path / "docs" / "results.md").read_text()
    assert "| mopg | 2 |" in told
    assert "Not run: walker2d (mopg, mopg-printed, ppo, dac" in told
    assert "python train.py env=invertedpendulum algo=mopg physics=native" in told
    published = tmp_path / "results" / "invertedpendulum" / "mopg" / "seeds.csv"
    header, first, _ = published.read_text().splitlines()
    assert header.startswith("seed,last_20_episodes,last_100k_steps,options_used,")
    assert first.startswith("100,")
    assert header.endswith(",best_option,worst_option")
    before = published.stat().st_mtime_ns
    (tmp_path / "docs" / "results.md").unlink()
    again = command("reproduce", *arguments[:-1], "seeds=1", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert published.stat().st_mtime_ns == before
    more = command("reproduce", *arguments[:-1], "seeds=3", cwd=tmp_path)
    assert more.returncode == 0, more.stderr
    assert published.read_text().splitlines()[:2] == [header, first]
    assert published.read_text().splitlines()[3].startswith("102,")
    told = (tmp_path / "docs" / "results.md").read_text()
    assert "| mopg | 3 |" in told
    assert "seeds=2 seed=100" in told
    assert "seeds=1 seed=102" in told
    written = command("reproduce", "results", cwd=tmp_path)
    assert written.returncode == 0, written.stderr
    assert (tmp_path / "docs" / "results.md").read_text() == told
    assert (tmp_path / "results" / "table2.png").is_file()
    assert "(../results/table2.png)" in told
    figure = command("reproduce", "figure3", *arguments[1:-1], "seeds=3", cwd=tmp_path)
    assert figure.returncode == 0, figure.stderr
    assert "### invertedpendulum" in figure.stdout
    assert "Table 1" not in figure.stdout  # the task is Table 2's
    drawn = command("reproduce", "curves", cwd=tmp_path)
    assert drawn.returncode == 0, drawn.stderr
    assert "mopg, seed 101" in (tmp_path / "results.html").read_text()
    other = command("reproduce", *arguments, "algo.gamma=0.9", cwd=tmp_path)
    assert other.returncode == 2
    assert "was published with other settings (algo.gamma: 0.9 here, 0.99 there)" in other.stderr
