import csv
import dataclasses
import io
import re

import numpy as np
import pytest
from rich.console import Console

from hitmdp_jax.cli.jobs import final_return
from hitmdp_jax.experiments.comparison_page import comparison_page
from hitmdp_jax.experiments.sweeps import by_setting, draw_sweep, rank, sweep_figure, table
from hitmdp_jax.report.run_report import RunReport
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.sinks import CsvSink
from hitmdp_jax.runs.sinks.terminal import TerminalSink

CONFIG = RunConfig(
    algo={"name": "ppo"}, seeds=2, sweep={"algo.gamma": [0.9, 0.95, 0.99]}, total_steps=3 * 2048
)
RETURNS = np.array([[1.0, 3.0], [5.0, 7.0], [9.0, np.nan]])  # by setting and seed


def metrics(returns=RETURNS):
    flat = returns.reshape(-1, 1).repeat(3, axis=1)
    steps = np.tile([2048.0, 4096.0, 6144.0], (6, 1))
    return {"env_steps": steps, "episode_return": flat, "episodes": np.isfinite(flat) * 1.0}


def test_the_best_setting_comes_first_and_what_has_no_return_last():
    results = rank(metrics(), CONFIG)
    assert [result.setting for result in results] == [1, 0, 2]
    assert [result.iqm for result in results[:2]] == [6.0, 2.0]
    assert results[0].swept == {"algo.gamma": 0.95}


def test_the_table_and_the_figure_show_every_setting():
    results = rank(metrics(), CONFIG)
    header, *rows = table(results)
    assert header[:4] == ["setting", "gamma", "seeds", "IQM of all 6,144 steps [95% interval]"]
    assert rows[0][2:4] == ["2", "6.00"]  # of two seeds there is no interval
    assert rows[0][:2] == ["1", "0.95"]
    assert rows[0][-1] == "5.0 7.0"
    assert rows[2][-1] == "9.0 -"
    (axes,) = sweep_figure(results, "a sweep", "mopg").axes
    assert "of 2 seeds" in axes.get_xlabel()
    assert axes.get_yticklabels()[0].get_text() == "gamma=0.95"
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), [5.0, 7.0])


def test_a_run_is_told_by_its_files(tmp_path):
    sink = CsvSink(tmp_path, CONFIG.trainings)
    for i in (1, 2, 3):
        returns = np.arange(6.0) * i
        values = {"episode_return": returns, "recent_return": returns, "episodes": np.ones(6)}
        sink.write(i, 2048 * i, values)
    sink.close()
    rows = draw_sweep(tmp_path, CONFIG)
    with (tmp_path / "sweep.csv").open(newline="") as file:
        assert list(csv.reader(file)) == rows
    assert rows[1][0] == "2"
    assert (tmp_path / "sweep.md").read_text().count("\n") == 5
    figures = {path.name for path in (tmp_path / "figures").iterdir()}
    assert figures == {"sweep.png", "learning_curve.png"}


def test_what_is_known_is_told_apart_by_setting():
    found = by_setting(CONFIG, {"x": np.arange(6), "y": np.arange(12).reshape(6, 2)})
    assert [(name, x["x"].tolist()) for name, x in found.items()] == [
        ("gamma=0.9", [0, 1]), ("gamma=0.95", [2, 3]), ("gamma=0.99", [4, 5])
    ]  # fmt: skip
    assert found["gamma=0.99"]["y"].shape == (2, 2)
    alike = dataclasses.replace(CONFIG, sweep={"algo.gamma": [0.9, 0.90001]})
    assert [*by_setting(alike, {})] == ["gamma=0.9 (setting 0)", "gamma=0.9 (setting 1)"]
    alone = dataclasses.replace(CONFIG, sweep=None)
    assert [*by_setting(alone, {})] == [""]


TOLD = np.array([[0.0, 2.0], [100.0, 104.0]])  # a worse setting and a better one, of two seeds
TWO = dataclasses.replace(CONFIG, env={"name": "hopper"}, sweep={"algo.gamma": [0.9, 0.99]})


def told_by_a_final_return(run_dir):
    return f"{final_return(run_dir, TWO):.1f} of 2 seeds"


def told_by_the_report(run_dir):
    return "".join(RunReport(run_dir, TWO, "", 0, None, None).summary())


def told_by_a_comparison(run_dir):
    page = comparison_page({"ppo": (run_dir, TWO)}, {"ppo": ""})
    assert "<td>ppo, gamma=0.9</td><td>2</td>" in page
    (row,) = re.findall(r"<tr><td>(ppo, gamma=0.99</td>.*?)</tr>", page)
    return row.replace("<td>2</td>", "2 seeds")


def told_by_the_terminal(run_dir):
    out = io.StringIO()
    sink = TerminalSink(2048, TWO.trainings)
    sink._console = Console(file=out, width=500)
    values = {"steps_per_second": np.ones(4), "diverged": np.zeros(4), "a_kl": TOLD.ravel() / 100}
    sink.write(1, 2048, values | {"recent_return": TOLD.ravel()})
    assert "KL a 1.020" in out.getvalue()
    return out.getvalue()


TELLERS = [told_by_a_final_return, told_by_the_report, told_by_a_comparison, told_by_the_terminal]


@pytest.mark.parametrize("teller", TELLERS)
def test_settings_are_never_told_of_as_if_they_were_seeds(tmp_path, teller):
    """One mean over 2 seeds x 2 settings would be 51.5, of 4 seeds."""
    sink = CsvSink(tmp_path, TWO.trainings)
    returns = {"episode_return": TOLD.ravel(), "episodes": np.ones(4)}
    sink.write(1, 2048, returns | {"steps_per_second": np.ones(4)})
    sink.close()
    told = teller(tmp_path)
    assert "102.0" in told
    assert "2 seeds" in told
    assert "4 seeds" not in told
    assert "51.5" not in told
