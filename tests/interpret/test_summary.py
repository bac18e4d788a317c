"""The one summary of a run, and the table of several."""

import math

import numpy as np
import pytest

from hitmdp_jax.interpret.comparison import sweep_table, table
from hitmdp_jax.interpret.summary import Summary, columns_of, rank, summarize
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.metrics import by_setting
from tests.interpret.reports import made_up

TASK = {"name": "dmc/cheetah_run"}
ONE = RunConfig(algo={"name": "mopg"}, env=TASK, seeds=3, total_steps=150 * 2048)
SWEPT = RunConfig(
    algo={"name": "ppo"}, seeds=2, sweep={"algo.gamma": [0.9, 0.95, 0.99]}, total_steps=3 * 2048
)
RETURNS = np.array([[1.0, 3.0], [5.0, 7.0], [9.0, np.nan]])  # by setting and seed


def reports(level, used, seeds=2):
    """Metrics of a hundred reports of 2000 steps, in which options act as `used` says."""
    shape = (seeds, 100)
    metrics = {
        "env_steps": np.tile(2000.0 * np.arange(1, 101), (seeds, 1)),
        "episode_return": np.tile(np.array([[100.0], [30.0]]) + level, (1, 100)),
        "episodes": np.ones(shape),
        "steps_per_second": np.full(shape, 100.0),
    }
    for name, of_options in used.items():
        for k, x in enumerate(np.array(of_options).T):
            metrics[f"{name}_{k}"] = np.tile(x[:, None], (1, 100))
    return metrics


def test_a_run_is_told_by_its_seeds_and_measured_against_the_control():
    config = RunConfig(algo={"name": "mopg"}, env=TASK, seeds=2, total_steps=200_000)
    # One seed changes its option every four steps, one never does.
    used = {
        "option_steps": [[80.0, 18.0, 2.0], [100.0, 0.0, 0.0]],
        "option_activations": [[20.0, 9.0, 2.0], [0.0, 0.0, 0.0]],
    }
    mopg, ppo = summarize(config, reports(100.0, used)), summarize(config, reports(0.0, {}))
    assert mopg.window == "the last 100,000 steps"
    np.testing.assert_allclose(mopg.returns, [200.0, 130.0])
    np.testing.assert_allclose(mopg.columns["options_used"], [2, 1])
    # fifty reports of a hundred steps
    np.testing.assert_allclose(mopg.columns["main_option_duration"], [4.0, 5000.0])
    assert "options_used" not in ppo.columns
    header, *rows = table({"ppo": ppo, "mopg": mopg}, "ppo", {"ppo": 7.0}, each=True)
    by_name = {row[0]: dict(zip(header, row, strict=True)) for row in rows}
    assert by_name["mopg"] == {
        "": "mopg",
        "seeds": "2",
        "last 20 episodes": "165.0 ± 35.0",
        "IQM of the last 100,000 steps [95% interval]": "165.0",
        "minus ppo [95% interval]": "100.0",  # two seeds, no interval
        "P(better)": "1.00",
        "failed": "0/2",
        "options, duration": "1/2, 2502.0",
        "steps/s": "200",
        "paper": "-",
        "per seed": "200 130",
    }
    assert by_name["ppo"]["failed"] == "1/2"  # 30 is less than half of 65
    assert by_name["ppo"]["options, duration"] == by_name["ppo"]["P(better)"].replace("", "-")
    assert by_name["ppo"]["paper"] == "7.0"


def test_what_no_run_knows_has_no_column_and_a_silent_seed_no_return():
    one = RunConfig(algo={"name": "ppo"}, env=TASK, total_steps=2048)
    metrics = {
        "env_steps": np.array([[2048.0]]),
        "episode_return": np.array([[math.nan]]),
        "episodes": np.zeros((1, 1)),
        "steps_per_second": np.array([[math.nan]]),
    }
    header, row = table({"ppo": summarize(one, metrics)}, each=True)
    assert dict(zip(header, row, strict=True)) == {"": "ppo", "seeds": "1", "failed": "0/1"}


def test_choices_and_scores_are_told_where_policies_were_evaluated():
    columns = columns_of(ONE, made_up(np.random.default_rng(0)))
    scores = {"evaluation": [9.0, 11.0, 10.0], "parameters": [7.0] * 3, "success": [0.5] * 3}
    scores |= {"own_choices": [3.0] * 3, "uniform_choices": [1.0, 2.0, 3.0]}
    scores |= {"best_option": [4.0] * 3, "worst_option": [0.0] * 3}
    run = Summary(ONE, columns | {name: np.array(x) for name, x in scores.items()})
    header, row = table({"mopg": run})
    told = dict(zip(header, row, strict=True))
    assert told["deterministic"] == "10.0 ± 0.8"
    assert told["choices"] == "3.00 / 2.00 / 4.00 / 0.00"
    assert told["own minus uniform"] == "1.00"
    assert (told["success"], told["parameters"]) == ("0.50 ± 0.00", "7")


def test_a_transfer_tells_its_tasks_apart():
    metrics = made_up(np.random.default_rng(1), reports=200)
    metrics["episode_return"][:, :100] = 5.0
    metrics["episode_return"][:, 100:] = 7.0
    config = RunConfig(
        algo={"name": "mopg"}, env=TASK, second_env=TASK, seeds=3, total_steps=100 * 2048
    )
    run = summarize(config, metrics)
    np.testing.assert_allclose(run.columns["first_task"], 5.0)
    np.testing.assert_allclose(run.columns["whole_second_task"], 7.0)
    np.testing.assert_allclose(run.returns, 7.0)
    assert (run.columns["options_used"] == 2).all()
    header, row = table({"mopg": run})
    told = dict(zip(header, row, strict=True))
    assert (told["first task, IQM"], told["mean after the switch, IQM"]) == ("5.00", "7.00")


def test_success_is_that_of_the_episodes_at_the_end_and_only_where_the_task_knows_it():
    metrics = made_up(np.random.default_rng(3))
    assert "success" not in columns_of(ONE, metrics)
    episodes = metrics["episodes"]
    metrics["success"] = np.where(episodes > 0, 0.25, np.nan)
    metrics["success"][:, -1], episodes[:, -1] = 1.0, 4.0
    last = metrics["env_steps"][0] > 150 * 2048 - 100_000
    before = episodes[:, last][:, :-1].sum(axis=1)
    expected = (0.25 * before + 4.0) / (before + 4.0)
    np.testing.assert_allclose(columns_of(ONE, metrics)["success"], expected)


def swept_metrics():
    flat = RETURNS.reshape(-1, 1).repeat(3, axis=1)
    steps = np.tile([2048.0, 4096.0, 6144.0], (6, 1))
    return {"env_steps": steps, "episode_return": flat, "episodes": np.isfinite(flat) * 1.0}


def test_the_best_setting_comes_first_and_what_has_no_return_last():
    ranked = rank(SWEPT, swept_metrics())
    assert [run.setting for run in ranked.values()] == [1, 0, 2]
    assert [run.iqm for run in ranked.values()][:2] == [6.0, 2.0]
    assert next(iter(ranked)) == "gamma=0.95"


def test_a_sweeps_table_shows_every_setting():
    header, *rows = sweep_table(rank(SWEPT, swept_metrics()))
    assert header[:4] == ["setting", "gamma", "seeds", "IQM of all 6,144 steps [95% interval]"]
    assert rows[0][:4] == ["1", "0.95", "2", "6.00"]  # of two seeds there is no interval
    assert [row[-1] for row in rows] == ["5.0 7.0", "1.0 3.0", "9.0 -"]


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ([0.9, 0.95], ["gamma=0.9", "gamma=0.95"]),
        ([0.9, 0.90001], ["gamma=0.9 (setting 0)", "gamma=0.9 (setting 1)"]),
        (None, [""]),
    ],
)
def test_what_is_known_is_told_apart_by_setting(values, names):
    config = RunConfig(algo={"name": "ppo"}, seeds=2, sweep=values and {"algo.gamma": values})
    found = by_setting(config, {"x": np.arange(2 * len(names)), "y": np.ones((2 * len(names), 5))})
    assert list(found) == names
    assert [x["x"].tolist() for x in found.values()] == [[0, 1], [2, 3]][: len(names)]
    assert all(x["y"].shape == (2, 5) for x in found.values())
