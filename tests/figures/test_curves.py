import numpy as np
import pytest

from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments.published import Cell, curves_of
from hitmdp_jax.experiments.results_figure import figure
from hitmdp_jax.figures.curves import (
    draw_figures,
    learning_curve,
    option_durations,
    smooth,
    window_sum,
)
from hitmdp_jax.figures.registry import RunMetrics, find
from hitmdp_jax.figures.style import styles
from hitmdp_jax.interpret.summary import summarize
from hitmdp_jax.report.interactive import learning_curves
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.metrics import read_metrics
from hitmdp_jax.runs.sinks import CsvSink
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


def test_a_killed_run_is_read_up_to_its_last_whole_iteration(tmp_path):
    write_run(tmp_path)
    path = tmp_path / "metrics.csv"
    text = path.read_bytes()
    row = b"31,3100,0,1.5,10,30,5,0\r\n"
    for torn in (b"31", row, row[:-1], row + b"31,31", row + b"31,3100,1,1."):
        path.write_bytes(text + torn)
        metrics = read_metrics(tmp_path)
        assert metrics["iteration"].shape == (2, 30)
        assert np.isnan(metrics["episode_return"][1, 0])
        assert metrics["episode_return"][1, 3] == 8.0
    assert draw_figures(tmp_path, "a run", "mopg")


def test_a_run_that_lost_a_training_is_not_read_as_another(tmp_path):
    """Whose places would be taken for those of the trainings that are left."""
    write_run(tmp_path)
    path = tmp_path / "metrics.csv"
    header, *rows = path.read_text().splitlines(keepends=True)
    path.write_text(header + "".join(row for row in rows if row.split(",")[2] == "1"))
    assert read_metrics(tmp_path)["seed"].tolist() == [[1.0] * 30]
    with pytest.raises(UsageError, match=r"has lost rows: it holds 1 of the run's 2 trainings\."):
        read_metrics(tmp_path, 2)
    path.write_text(header + rows[0])  # a run that writes its first report
    assert read_metrics(tmp_path, 2) == {}


@pytest.mark.parametrize("text", ["", "iteration,env_steps,seed", "iteration,env_steps,seed\r\n"])
def test_a_run_without_rows_has_no_metrics_and_no_figures(tmp_path, text):
    (tmp_path / "metrics.csv").write_text(text)
    assert read_metrics(tmp_path) == {}
    assert draw_figures(tmp_path, "a run", "mopg") == []


def test_rows_of_an_iteration_are_told_apart_by_more_than_their_seed(tmp_path):
    rows = ["iteration,env_steps,seed,setting,algo.gamma,x"]
    rows += [
        f"{i},{i},{s},{k},{g},{i + s + g}"
        for i in (1, 2)
        for k, g in enumerate((0.5, 0.75))
        for s in (0, 1)
    ]
    (tmp_path / "metrics.csv").write_text("\n".join(rows) + "\n")
    metrics = read_metrics(tmp_path)
    np.testing.assert_array_equal(metrics["x"][:, 0], [1.5, 2.5, 1.75, 2.75])
    np.testing.assert_array_equal(metrics["algo.gamma"][:, 1], [0.5, 0.5, 0.75, 0.75])


def test_smoothing_averages_the_window_and_skips_gaps():
    x = np.array([[np.nan, 2.0, 4.0, np.nan, 9.0]])
    np.testing.assert_allclose(smooth(x, np.arange(5), None, 2), [[np.nan, 2.0, 3.0, 4.0, 9.0]])


def test_window_sums_add_the_last_points_of_one_task():
    x, steps = np.array([[1.0, 2.0, 3.0, 4.0]]), 10 * np.arange(1, 5)
    np.testing.assert_allclose(window_sum(x, steps, None, 2), [[1, 3, 5, 7]])
    np.testing.assert_allclose(window_sum(x, steps, 20, 2), [[1, 3, 3, 7]])
    np.testing.assert_allclose(window_sum(x, steps, 40, 2), [[1, 3, 5, 7]])  # not there yet


N, SWITCH = 60, 3000  # reports of 100 steps each


def transfer():
    """A seed whose return and option change at once where the second task begins, report 31."""
    second = np.arange(N)[None] >= SWITCH // 100
    return {
        "seed": np.zeros((1, N)),
        "env_steps": 100.0 * np.arange(1, N + 1)[None],
        "episode_return": np.where(second, 2.0, 900.0),
        "option_steps_0": np.where(second, 0.0, 100.0),
        "option_steps_1": np.where(second, 100.0, 0.0),
        "option_activations_0": np.where(second, 0.0, 10.0),
        "option_activations_1": np.where(second, 50.0, 0.0),
    }


RUN = RunMetrics("a", transfer(), "mopg", SWITCH)


def curve_of_seeds(_):
    return learning_curve(transfer(), "a run", "mopg", SWITCH).axes[0].lines[0].get_xydata()


def curve_of_an_experiment(_):
    task = {"name": "dmc/cheetah_run"}
    sizes = {"total_steps": SWITCH, "num_envs": 1, "rollout_length": SWITCH}
    algo = {"name": "ppo", "minibatch_size": 100}
    config = RunConfig(algo=algo, env=task, second_env=task, **sizes)
    assert config.switch_at == SWITCH
    metrics = transfer() | {"episodes": np.ones((1, N))}
    cell = Cell(summarize(config, metrics), curves_of(config, metrics))
    return figure({"task": {"ppo": cell}}).axes[0].lines[0].get_xydata()


def curve_of_the_page(_):
    (curve,) = learning_curves({"a": transfer()}, styles({"a": "mopg"}), {"a": SWITCH}).data
    return np.stack([curve.x, curve.y], axis=1)


def curve_of_figure_6(_):
    lasting, shares = find("figure6").draw(RUN).axes
    after = shares.collections[0].get_paths()[0].vertices  # the share of option 0
    after = after[(after[:, 0] > SWITCH) & (after[:, 1] > 0)]
    assert not len(after), "option 0 is drawn where it was no longer followed"
    return lasting.lines[1].get_xydata()


def curve_of_figure_8(_):
    return find("figure8").draw([RUN]).axes[0].lines[1].get_xydata()


@pytest.mark.parametrize(
    "curve",
    [
        curve_of_seeds,
        curve_of_an_experiment,
        curve_of_the_page,
        curve_of_figure_6,
        curve_of_figure_8,
    ],
)
def test_no_curve_mixes_the_tasks_of_a_transfer(curve, tmp_path):
    """The first point of the second task is as it was measured, 2, and not a mean with 900."""
    steps, values = np.asarray(curve(tmp_path), float).T
    assert values[steps > SWITCH][0] == pytest.approx(2.0)


def test_figures_follow_what_was_logged(tmp_path):
    write_run(tmp_path, options=False)
    assert [p.name for p in draw_figures(tmp_path, "a run", "mopg")] == ["learning_curve.png"]
    write_run(tmp_path)
    paths = draw_figures(tmp_path, "a run", "mopg")
    assert [p.name for p in paths] == ["learning_curve.png", "option_durations.png"]
    assert all(p.stat().st_size > 10_000 for p in paths)


def test_every_seed_is_seen_also_one_that_was_lost():
    n = 60
    returns = np.stack([np.arange(n), 2.0 * np.arange(n), np.ones(n)])
    returns[2, 10:] = np.inf
    metrics = {"env_steps": np.tile(np.arange(n), (3, 1)), "episode_return": returns}
    (axes,) = learning_curve(metrics, "a run", "ppo").axes
    mean, *seeds = axes.lines[:4]
    assert [np.isfinite(seed.get_ydata()).sum() for seed in seeds] == [60, 60, 29]
    assert len(mean.get_ydata()) == 29  # no mean of the survivors


@pytest.mark.parametrize("durations", [(2.0, 9.0), (11.0, 18.0), (3.0, 1e5)])
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
