import numpy as np

from hitmdp_jax.experiments.results import Cell
from hitmdp_jax.experiments.results_page import Suite, all_tasks, commands
from hitmdp_jax.runs.config import RunConfig

CONFIG = RunConfig(algo={"name": "ppo"}, env={"name": "hopper"})
SUITE = Suite(
    title="",
    about="",
    settings=[],
    tasks={"hopper": [], "ant": [], "reacher": []},
    arms={"mopg": [], "ppo": [], "dac": []},
    control="ppo",
    paper={},
    elsewhere="",
    policies=[],
)


def cell(*returns, times=3):
    """A cell of each of the returns so many times: of six seeds, say."""
    return Cell(CONFIG, {"last_100k_steps": np.repeat(returns, times)}, {})


def test_arms_are_held_against_the_control_where_both_are_published():
    cells = {
        "hopper": {"mopg": cell(3.0, 4.0), "ppo": cell(1.0, 2.0), "dac": cell(0.0, 0.0)},
        "ant": {"mopg": cell(1.0, 1.0), "ppo": cell(1.0, times=9)},
        "reacher": {"mopg": cell(9.0, 9.0), "dac": cell(9.0, 9.0)},
    }
    header, *rows = all_tasks(SUITE, cells)
    assert header[3].startswith("P(better than ppo)")
    # dac meets the control on one task alone
    # and few seeds have no interval, all tasks' together
    few = {task: {name: cell(1.0) for name in ("mopg", "ppo")} for task in ("hopper", "ant")}
    assert all_tasks(SUITE, few)[1] == ["mopg", "2", "3", "0.50 [0.50, 0.50]", ""]
    few = {task: {name: cell(1.0, times=2) for name in ("mopg", "ppo")} for task in few}
    assert all_tasks(SUITE, few)[1] == ["mopg", "2", "2", "0.50", ""]
    assert rows == [["mopg", "2", "6", "0.75 [0.75, 0.75]", ""]]


def test_the_first_arm_is_held_against_the_others():
    cells = {
        "hopper": {"mopg": cell(3.0, 4.0), "ppo": cell(1.0, 2.0), "dac": cell(0.0, 0.0)},
        "ant": {"mopg": cell(1.0, 1.0), "ppo": cell(1.0, 1.0), "dac": cell(1.0, 1.0)},
        "reacher": {"ppo": cell(9.0, 9.0), "dac": cell(9.0, 9.0)},  # not mopg
    }
    header, *rows = all_tasks(SUITE, cells)
    assert header[4].startswith("P(mopg better)")
    assert rows == [
        ["mopg", "2", "6", "0.75 [0.75, 0.75]", ""],
        ["dac", "2", "6", "0.25 [0.25, 0.25]", "0.75 [0.75, 0.75]"],
    ]


def test_what_cells_were_made_with_is_told_once():
    def made(by, hours, *machines):
        about = {"command": by, "day": "2026-11-29", "hours": hours, "with": "; ".join(machines)}
        return Cell(CONFIG, {}, about)

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
