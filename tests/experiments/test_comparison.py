import csv
import warnings

import numpy as np
import pytest

from hitmdp_jax.experiments import tables
from hitmdp_jax.experiments.comparison import (
    compare,
    comparison_figure,
    final_returns,
    final_window,
    headline,
    length_warning,
    one_window,
    table,
)
from hitmdp_jax.runs.sinks import CsvSink
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


METRICS = {
    "env_steps": np.array([[100_000, 200_000, 250_000, 300_000]]),
    "episode_return": np.array([[-99.0, -99.0, 1.0, 5.0]]),
    "episodes": np.array([[1.0, 1.0, 3.0, 1.0]]),
}


@pytest.mark.parametrize(
    ("reports", "switch_at", "expected", "window"),
    [
        # after 200,000: (3 * 1 + 1 * 5) / 4
        (4, None, 2.0, "the last 100,000 steps"),
        (4, 250_000, 5.0, "all 50,000 steps of the second task"),
        (4, 100_000, 2.0, "the last 100,000 steps"),
        (4, 300_000, 2.0, "the last 100,000 steps"),  # the second task has not begun
        (1, None, -99.0, "all 100,000 steps"),
    ],
)
def test_final_returns_weigh_the_last_episodes_and_say_which(reports, switch_at, expected, window):
    metrics = {name: x[:, :reports] for name, x in METRICS.items()}
    np.testing.assert_allclose(final_returns(metrics, switch_at), [expected])
    assert final_window(metrics, switch_at) == window
    name, score = headline(metrics, switch_at)
    assert name == f"return of {window}"
    assert float(score) == expected


def test_runs_are_compared(tmp_path):
    run_dirs = {"mopg": tmp_path / "mopg", "ppo": tmp_path / "ppo"}
    write_run(run_dirs["mopg"], 100.0)
    write_run(run_dirs["ppo"], 200.0)
    results = compare(run_dirs, {"mopg": 10, "ppo": 20})
    np.testing.assert_allclose(results[0].final_returns, [100.0, 110.0])
    assert results[0].steps_per_second == 100.0
    tables.save(table(results), tmp_path, "comparison")
    with (tmp_path / "comparison.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["mean"] for row in rows] == ["105.0", "205.0"]
    assert [row["IQM of the last 100,000 steps [95% interval]"] for row in rows] == [
        "105.0", "205.0"
    ]  # fmt: skip
    assert {row["seeds"] for row in rows} == {"2"}
    assert (tmp_path / "comparison.md").read_text().count("\n") == 4
    (axes,) = comparison_figure(run_dirs, "two tasks", switch_at=100_000).axes
    assert axes.get_legend_handles_labels()[1] == ["mopg", "ppo"]
    assert len(axes.lines) == 2 * (1 + 2) + 1  # mean and two seeds each, and the switch
    np.testing.assert_array_equal(axes.lines[-1].get_xdata(), 100_000)


def test_a_single_report_has_no_speed_and_a_silent_seed_no_return(tmp_path):
    (tmp_path / "ppo").mkdir()
    sink = CsvSink(tmp_path / "ppo", trainings(1))
    values = {"episode_return": np.nan, "episodes": 0.0, "steps_per_second": np.nan}
    sink.write(1, 2000, {name: np.array([x]) for name, x in values.items()})
    sink.close()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        results = compare({"ppo": tmp_path / "ppo"}, {"ppo": 20})
    header, row = table(results)
    assert header[2] == "IQM of all 2,000 steps [95% interval]"
    assert row == ["ppo", "1", "-", "-", "-", "-", "-", "20"]


def test_runs_of_unlike_length_are_compared_with_a_warning():
    assert length_warning({"mopg": 2_002_944, "oc": 2_003_280}) is None
    assert length_warning({"mopg": 100_000, "ppo": 20_480}) == (
        "The runs are of unlike length, and a longer one learned for longer: mopg 100,000, "
        "ppo 20,480 steps."
    )
    assert one_window(["all 20,480 steps"] * 2) == "all 20,480 steps"
    assert one_window(["all 20,480 steps", "the last 100,000 steps"]) == (
        "the last 100,000 steps, or all of a shorter run"
    )
