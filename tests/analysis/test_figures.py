import numpy as np
import pytest

from hitmdp_jax.analysis.figures import (
    draw_figures,
    learning_curve,
    option_color,
    option_durations,
    read_metrics,
    smooth,
    window_sum,
)
from hitmdp_jax.training.sinks import CsvSink
from tests.probes import trainings


def write_run(folder, iterations=30, options=True):
    sink = CsvSink(folder, trainings())
    for i in range(1, iterations + 1):
        metrics = {"episode_return": np.array([float(i), np.nan if i < 3 else 2.0 * i])}
        if options:
            metrics["option_steps"] = np.array([[10.0, 30.0]] * 2)
            metrics["option_activations"] = np.array([[5.0, 0.0]] * 2)
        sink.write(i, 100 * i, metrics)
    sink.close()


def test_metrics_are_read_by_seed(tmp_path):
    write_run(tmp_path)
    metrics = read_metrics(tmp_path)
    assert metrics["episode_return"].shape == (2, 30)
    assert np.isnan(metrics["episode_return"][1, 0])
    assert metrics["episode_return"][1, 3] == 8.0


def test_a_killed_run_is_read_up_to_its_last_whole_iteration(tmp_path):
    write_run(tmp_path)
    path = tmp_path / "metrics.csv"
    text = path.read_bytes()
    row = b"31,3100,0,1.5,10,30,5,0\r\n"
    for torn in (b"31", row, row[:-1], row + b"31,31", row + b"31,3100,1,1."):
        path.write_bytes(text + torn)
        assert read_metrics(tmp_path)["iteration"].shape == (2, 30)
    assert draw_figures(tmp_path, "a run")


@pytest.mark.parametrize("text", ["", "iteration,env_steps,seed", "iteration,env_steps,seed\r\n"])
def test_a_run_without_rows_has_no_metrics_and_no_figures(tmp_path, text):
    (tmp_path / "metrics.csv").write_text(text)
    assert read_metrics(tmp_path) == {}
    assert draw_figures(tmp_path, "a run") == []


def test_rows_of_an_iteration_are_told_apart_by_more_than_their_seed(tmp_path):
    rows = ["iteration,env_steps,seed,algo.gamma,x"]
    rows += [f"{i},{i},{s},{g},{i + s + g}" for i in (1, 2) for g in (0.5, 0.75) for s in (0, 1)]
    (tmp_path / "metrics.csv").write_text("\n".join(rows) + "\n")
    metrics = read_metrics(tmp_path)
    np.testing.assert_array_equal(metrics["x"][:, 0], [1.5, 2.5, 1.75, 2.75])
    np.testing.assert_array_equal(metrics["algo.gamma"][:, 1], [0.5, 0.5, 0.75, 0.75])


def test_smoothing_averages_the_window_and_skips_gaps():
    x = np.array([[np.nan, 2.0, 4.0, np.nan, 9.0]])
    np.testing.assert_allclose(smooth(x, window=2), [[np.nan, 2.0, 3.0, 4.0, 9.0]])


def test_window_sums_add_the_last_points():
    np.testing.assert_allclose(window_sum(np.array([[1.0, 2.0, 3.0, 4.0]]), 2), [[1, 3, 5, 7]])


def test_figures_follow_what_was_logged(tmp_path):
    write_run(tmp_path, options=False)
    assert [p.name for p in draw_figures(tmp_path, "a run")] == ["learning_curve.png"]
    write_run(tmp_path)
    paths = draw_figures(tmp_path, "a run")
    assert [p.name for p in paths] == ["learning_curve.png", "option_durations.png"]
    assert all(p.stat().st_size > 10_000 for p in paths)


def test_every_seed_is_seen_also_one_that_was_lost():
    n = 60
    returns = np.stack([np.arange(n), 2.0 * np.arange(n), np.ones(n)])
    returns[2, 10:] = np.inf
    metrics = {"env_steps": np.tile(np.arange(n), (3, 1)), "episode_return": returns}
    (axes,) = learning_curve(metrics, "a run").axes
    mean, *seeds = axes.lines[:4]
    assert [np.isfinite(seed.get_ydata()).sum() for seed in seeds] == [60, 60, 29]
    assert len(mean.get_ydata()) == 29  # no mean of the survivors


@pytest.mark.parametrize("durations", [(1.0, 150.0), (2.0, 9.0), (11.0, 18.0), (3.0, 1e5)])
def test_durations_are_labelled_in_plain_numbers(durations):
    steps = np.full((1, 30), 2048.0)
    metrics = {"env_steps": 2048 * np.arange(30)[None]}
    for k, duration in enumerate(durations):
        metrics |= {f"option_steps_{k}": steps, f"option_activations_{k}": steps / duration}
    figure = option_durations(metrics, "a run")
    figure.draw_without_rendering()
    axis = figure.axes[0].yaxis
    low, high = figure.axes[0].get_ylim()
    ticks = [
        t
        for t, x in zip(axis.get_ticklabels(), axis.get_ticklocs(), strict=True)
        if low <= x <= high
    ]
    assert len(ticks) >= 2
    assert all(float(tick.get_text()) and "$" not in tick.get_text() for tick in ticks)
    assert not any(tick.get_text() for tick in axis.get_ticklabels(minor=True))


def test_options_are_told_apart_by_colour():
    assert len({option_color(k) for k in range(21)}) == 21
    assert option_color(0) == "#4477aa"
