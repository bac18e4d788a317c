import numpy as np
from hitmdp_jax.training.sinks import CsvSink

from hitmdp_jax.analysis.figures import draw_figures, read_metrics, smooth, window_sum


def write_run(folder, iterations=30, options=True):
    sink = CsvSink(folder, first_seed=0)
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
