import numpy as np
import pytest

from hitmdp_jax.experiments import ablation
from hitmdp_jax.figures.curves import read_metrics
from hitmdp_jax.runs.sinks import CsvSink
from tests.probes import trainings


@pytest.fixture
def run_dirs(tmp_path):
    folders = {name: tmp_path / name for name in ("ppo", "mopg")}
    for name, folder in folders.items():
        folder.mkdir()
        sink = CsvSink(folder, trainings())
        for i in range(1, 101):
            values = {
                "episode_return": np.array([100.0, 30.0]) + 100.0 * (name == "mopg"),
                "episodes": np.ones(2),
                "steps_per_second": np.full(2, 100.0),
            }
            if name == "mopg":  # one seed changes its option every four steps, one never does
                values["option_steps"] = np.array([[80.0, 18.0, 2.0], [100.0, 0.0, 0.0]])
                values["option_activations"] = np.array([[20.0, 9.0, 2.0], [0.0, 0.0, 0.0]])
            sink.write(i, 2000 * i, values)
        sink.close()
    return folders


def test_arms_are_measured_against_the_control(run_dirs):
    runs = {name: read_metrics(folder) for name, folder in run_dirs.items()}
    ppo, mopg = ablation.measure(runs, dict.fromkeys(runs), "ppo")
    assert mopg.window == "the last 100,000 steps"
    np.testing.assert_allclose(mopg.final_returns, [200.0, 130.0])
    np.testing.assert_allclose(mopg.control, ppo.final_returns)
    np.testing.assert_allclose(mopg.used, [2, 1])
    np.testing.assert_allclose(mopg.duration, [4.0, 5000.0])  # fifty reports of a hundred steps
    assert np.isnan(ppo.used).all()
    assert (ppo.failed, mopg.failed) == (1, 0)  # 30 is less than half of 65
    assert mopg.minutes == pytest.approx(200_000 / 100 / 60)
    header, *rows = ablation.table([ppo, mopg])
    by_name = {row[0]: dict(zip(header, row, strict=True)) for row in rows}
    assert by_name["mopg"]["P(better)"] == "1.00"
    assert by_name["mopg"]["seeds"] == "2"
    assert by_name["mopg"]["minus control [95% interval]"] == "100.0"  # two seeds, no interval
    assert by_name["mopg"]["options used"] == "1/2 use 2+"
    assert by_name["ppo"]["options used"] == by_name["ppo"]["duration"] == "-"


@pytest.mark.parametrize(("returns", "failed"), [([-4.0, -5.0, -9.0], 1), ([4.0, 5.0, 1.0], 1)])
def test_a_seed_far_below_the_median_has_failed(returns, failed):
    nothing = np.full(3, np.nan)
    arm = ablation.Arm("ppo", "all", 9, np.array(returns), nothing, nothing, nothing, 0.0)
    assert arm.failed == failed
