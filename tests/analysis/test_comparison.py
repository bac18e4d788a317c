import csv
import warnings

import numpy as np
import pytest

from hitmdp_jax.analysis import tables
from hitmdp_jax.analysis.comparison import (
    compare,
    comparison_figure,
    final_returns,
    table,
)
from hitmdp_jax.training.sinks import CsvSink
from tests.probes import trainings


def write_run(folder, level):
    folder.mkdir()
    sink = CsvSink(folder, trainings())
    for i in range(1, 101):
        known = np.array([i % 2, 1.0])
        values = {
            "episode_return": np.where(known > 0, level + np.array([0.0, 10.0]), np.nan),
            "episodes": known,
            "steps_per_second": np.array([50.0, 50.0]),
        }
        sink.write(i, 2000 * i, values)
    sink.close()


def test_final_returns_weigh_the_last_episodes():
    metrics = {
        "env_steps": np.array([[100_000, 200_000, 250_000, 300_000]]),
        "episode_return": np.array([[-99.0, -99.0, 1.0, 5.0]]),
        "episodes": np.array([[1.0, 1.0, 3.0, 1.0]]),
    }
    # after 200,000: (3 * 1 + 1 * 5) / 4
    np.testing.assert_allclose(final_returns(metrics), [2.0])
    # a transfer's second task began at 250,000
    np.testing.assert_allclose(final_returns(metrics, since=250_000), [5.0])


def test_runs_are_compared(tmp_path):
    run_dirs = {"mopg": tmp_path / "mopg", "ppo": tmp_path / "ppo"}
    write_run(run_dirs["mopg"], 100.0)
    write_run(run_dirs["ppo"], 200.0)
    results = compare(run_dirs, {"mopg": 10, "ppo": 20})
    np.testing.assert_allclose(results[0].final_returns, [100.0, 110.0])
    assert results[1].iqm == pytest.approx(205.0)
    assert results[0].steps_per_second == 100.0
    tables.save(table(results), tmp_path, "comparison")
    with (tmp_path / "comparison.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["return"] for row in rows] == ["105.0", "205.0"]
    assert (tmp_path / "comparison.md").read_text().count("\n") == 4
    (axes,) = comparison_figure(run_dirs, "two tasks", switch_at=100_000).axes
    assert axes.get_legend_handles_labels()[1] == ["mopg", "ppo"]
    assert len(axes.lines) == 2 * (1 + 2) + 1  # mean and two seeds each, and the switch
    np.testing.assert_array_equal(axes.lines[-1].get_xdata(), 100_000)


def test_a_single_seed_has_no_interval_and_a_silent_one_no_return(tmp_path):
    (tmp_path / "ppo").mkdir()
    sink = CsvSink(tmp_path / "ppo", trainings(1))
    values = {"episode_return": np.nan, "episodes": 0.0, "steps_per_second": 50.0}
    sink.write(1, 2000, {name: np.array([x]) for name, x in values.items()})
    sink.close()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        results = compare({"ppo": tmp_path / "ppo"}, {"ppo": 20})
    assert table(results)[1] == ["ppo", "-", "-", "- [-, -]", "-", "50", "20"]
