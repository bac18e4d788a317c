import numpy as np

from hitmdp_jax.analysis.results import Cell
from hitmdp_jax.analysis.results_page import Suite, all_tasks
from hitmdp_jax.training.config import RunConfig

CONFIG = RunConfig(algo={"name": "ppo"}, env={"name": "hopper"})
SUITE = Suite(
    title="",
    about="",
    settings=[],
    tasks={"hopper": [], "ant": [], "reacher": [], "swimmer": []},
    arms={"mopg": [], "ppo": [], "dac": [], "oc": []},
    control="ppo",
    paper={},
    elsewhere="",
    policies=[],
)


def cell(*returns):
    return Cell(CONFIG, {"last_100k_steps": np.array(returns)}, {})


def test_arms_are_held_against_the_control_and_the_first_arm_where_all_are_published():
    cells = {
        "hopper": {"mopg": cell(3.0, 4.0), "ppo": cell(1.0, 2.0), "dac": cell(0.0, 0.0)},
        "ant": {"mopg": cell(1.0, 1.0), "ppo": cell(1.0, 1.0, 1.0), "dac": cell(2.0, 1.0)},
        "reacher": {"mopg": cell(9.0, 9.0), "dac": cell(9.0, 9.0), "oc": cell(0.0, 0.0)},
        "swimmer": {"mopg": cell(1.0, 2.0), "ppo": cell(3.0, 3.0), "oc": cell(0.0, 0.0)},
    }
    header, *rows = all_tasks(SUITE, cells)
    assert header[2].startswith("P(better than ppo)")
    assert header[3].startswith("P(mopg better)")
    mopg, dac = rows  # oc meets the other two on one task alone
    assert mopg == ["mopg", "3", "0.50 [0.50, 0.50]", ""]
    assert dac[:2] == ["dac", "2"]
    # hopper: it loses to both; ant: half of its seeds are level with each, half are better.
    assert dac[2].startswith("0.38 [")
    assert dac[3].startswith("0.62 [")
