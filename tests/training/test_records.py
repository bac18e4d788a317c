import csv

import numpy as np
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from hitmdp_jax.training.records import Records


def metrics(value):
    return {
        "a_metric": np.array([value, value + 1.0]),
        "option_steps": np.array([[1.0, 2.0], [3.0, 4.0]]),
        "episode_return": np.array([np.nan, 7.0]),
    }


def rows_of(path):
    with (path / "metrics.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_one_row_an_iteration_and_seed(tmp_path):
    records = Records(tmp_path, first_seed=5)
    records.write(1, 2048, metrics(0.5))
    records.close()
    rows = rows_of(tmp_path)
    assert list(rows[0])[:4] == ["iteration", "env_steps", "seed", "episode_return"]
    assert [row["seed"] for row in rows] == ["5", "6"]
    assert [row["option_steps_1"] for row in rows] == ["2", "4"]
    assert [row["episode_return"] for row in rows] == ["", "7"]


def test_resuming_drops_rows_after_the_checkpoint(tmp_path):
    records = Records(tmp_path, first_seed=0)
    for i in (1, 2, 3):
        records.write(i, 10 * i, metrics(float(i)))
    records.close()
    records = Records(tmp_path, first_seed=0, resume_after=2)
    records.write(3, 30, metrics(33.0))
    records.close()
    assert [row["a_metric"] for row in rows_of(tmp_path)] == ["1", "2", "2", "3", "33", "34"]


def test_tensorboard_reads_means_and_deviations(tmp_path):
    records = Records(tmp_path, first_seed=0)
    records.write(1, 2048, metrics(0.5))
    records.close()
    events = EventAccumulator(str(tmp_path)).Reload()
    assert events.Scalars("a_metric/mean")[0].value == 1.0
    assert events.Scalars("a_metric/std")[0].value == 0.5
    assert events.Scalars("episode_return/mean")[0].step == 2048
