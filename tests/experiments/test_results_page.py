"""The page about what is published, from cells and from the published ones."""

import numpy as np
import pytest

from hitmdp_jax.cli.published import read_cells
from hitmdp_jax.experiments import experiment
from hitmdp_jax.experiments.experiment import Experiment
from hitmdp_jax.experiments.published import Cell
from hitmdp_jax.experiments.results_page import (
    all_pairs,
    all_tasks,
    commands,
    narrow_tables,
    page,
    section,
    task_table,
)
from hitmdp_jax.interpret.summary import Summary
from hitmdp_jax.runs.config import RunConfig
from tests.cli.conftest import CHECKOUT

CONFIG = RunConfig(algo={"name": "ppo"}, env={"name": "hopper"})
EXPERIMENT = Experiment(
    title="Which?",
    tasks={"hopper": [], "ant": [], "reacher": []},
    arms={"mopg": [], "ppo": [], "dac": []},
    control="ppo",
)


@pytest.fixture(scope="module")
def published():
    """The experiments of the page, and what is published of their tasks: read in five seconds."""
    every = experiment.published()
    tasks = {task for one in every.values() for task in one.tasks}
    return every, read_cells(CHECKOUT / "results", tasks)


def test_the_page_is_that_of_the_published_results(published):
    every, cells = published
    pictures = {name: f"../results/{name}.png" for name in every}
    written = page(every, cells, pictures)
    assert written == (CHECKOUT / "docs/results.md").read_text()


@pytest.mark.whole
def test_narrow_tables_have_every_cell_of_the_wide_one(published):
    every, cells = published
    for one in every.values():
        for task in one.tasks:
            here = {arm: cells[task][arm] for arm in one.arms if arm in cells.get(task, {})}
            if not here:
                continue
            header, *rows = task_table(one, task, here)
            parts = narrow_tables([header, *rows])
            lines = "".join(parts).splitlines()
            split = [line[2:-2].split(" | ") for line in lines if line.startswith("| ")]
            assert max(map(len, split)) <= 7
            for row in (header, *rows):
                found = [cell for line in split if line[0] == row[0] for cell in line[1:]]
                assert {*row[1:]} - {"-", ""} <= {*found}, row[0]


def test_what_is_missing_is_named():
    told = section("own", EXPERIMENT, {})
    assert told.startswith("## Which?\n")
    assert "Not run: hopper (mopg, ppo, dac); ant (mopg, ppo, dac)" in told


def cell(*returns, times=3):
    """A cell of each of the returns so many times: of six seeds, say."""
    return Cell(Summary(CONFIG, {"last_100k_steps": np.repeat(returns, times)}), {})


def test_arms_are_held_against_the_control_where_both_are_published():
    cells = {
        "hopper": {"mopg": cell(3.0, 4.0), "ppo": cell(1.0, 2.0), "dac": cell(0.0, 0.0)},
        "ant": {"mopg": cell(1.0, 1.0), "ppo": cell(1.0, times=9)},
        "reacher": {"mopg": cell(9.0, 9.0), "dac": cell(9.0, 9.0)},
    }
    header, *rows = all_tasks(EXPERIMENT, cells)
    assert header[3].startswith("P(better than ppo)")
    # dac meets the control on one task alone
    # and few seeds have no interval, all tasks' together
    few = {task: {name: cell(1.0) for name in ("mopg", "ppo")} for task in ("hopper", "ant")}
    assert all_tasks(EXPERIMENT, few)[1] == ["mopg", "2", "3", "0.50 [0.50, 0.50]", ""]
    few = {task: {name: cell(1.0, times=2) for name in ("mopg", "ppo")} for task in few}
    assert all_tasks(EXPERIMENT, few)[1] == ["mopg", "2", "2", "0.50", ""]
    assert rows == [["mopg", "2", "6", "0.75 [0.75, 0.75]", ""]]


def test_the_first_arm_is_held_against_the_others():
    cells = {
        "hopper": {"mopg": cell(3.0, 4.0), "ppo": cell(1.0, 2.0), "dac": cell(0.0, 0.0)},
        "ant": {"mopg": cell(1.0, 1.0), "ppo": cell(1.0, 1.0), "dac": cell(1.0, 1.0)},
        "reacher": {"ppo": cell(9.0, 9.0), "dac": cell(9.0, 9.0)},  # not mopg
    }
    header, *rows = all_tasks(EXPERIMENT, cells)
    assert header[4].startswith("P(mopg better)")
    assert rows == [
        ["mopg", "2", "6", "0.75 [0.75, 0.75]", ""],
        ["dac", "2", "6", "0.25 [0.25, 0.25]", "0.75 [0.75, 0.75]"],
    ]


def test_every_pair_of_arms_is_told_on_the_tasks_that_they_share():
    cells = {
        "hopper": {"mopg": cell(3.0, 4.0), "ppo": cell(1.0, 2.0), "dac": cell(1.0, 2.0)},
        "ant": {"mopg": cell(1.0, 1.0), "ppo": cell(1.0, 1.0)},
        "reacher": {"ppo": cell(9.0, 9.0), "dac": cell(0.0, 9.0)},
    }
    assert all_pairs(EXPERIMENT, cells) == [
        ["", "mopg", "ppo", "dac"],
        ["mopg", "", "0.75", ""],  # one task alone with dac
        ["ppo", "0.25", "", "0.62"],
        ["dac", "", "0.38", ""],
    ]


def test_what_cells_were_made_with_is_told_once():
    def made(by, hours, *machines):
        about = {"command": by, "day": "2026-11-29", "hours": hours, "with": "; ".join(machines)}
        return Summary(CONFIG, {}, about)

    runs = {
        "ant/mopg": made("first; rest", 1.5, "a", "b"),
        "ant/ppo": made("one", 0.25, "b"),
    }
    (_, *made_by), (_, *machines) = commands(runs)
    assert made_by == [
        ["ant/mopg", "`first; rest`", "2026-11-29", "1.50", "1, 2"],
        ["ant/ppo", "`one`", "2026-11-29", "0.25", "2"],
    ]
    assert machines == [["1", "a"], ["2", "b"]]
