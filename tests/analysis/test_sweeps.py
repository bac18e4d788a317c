import csv

import numpy as np

from hitmdp_jax.analysis.sweeps import draw_sweep, rank, sweep_figure, table
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.sinks import CsvSink

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
    assert 5.0 <= results[0].low <= 6.0 <= results[0].high <= 7.0


def test_the_table_and_the_figure_show_every_setting():
    results = rank(metrics(), CONFIG)
    header, *rows = table(results)
    assert header[:2] == ["setting", "gamma"]
    assert rows[0][:2] == ["1", "0.95"]
    assert rows[0][-1] == "5.0 7.0"
    assert rows[2][-1] == "9.0 -"
    (axes,) = sweep_figure(results, "a sweep", "mopg").axes
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
