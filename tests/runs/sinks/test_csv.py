import csv

import numpy as np
import pytest

from hitmdp_jax.runs.metrics import read_metrics
from hitmdp_jax.runs.sinks import CsvSink
from hitmdp_jax.training.sweep import Training
from tests.probes import trainings


def metrics(value):
    return {
        "a_metric": np.array([value, value + 1.0]),
        "option_steps": np.array([[1.0, 2.0], [3.0, 4.0]]),
        "episode_return": np.array([np.nan, 7.0]),
    }


def rows_of(path):
    with (path / "metrics.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def written(tmp_path):
    sink = CsvSink(tmp_path, trainings())
    for i in (1, 2, 3):
        sink.write(i, 10 * i, metrics(float(i)))
    sink.close()
    return tmp_path


def test_one_row_an_iteration_and_seed(tmp_path):
    sink = CsvSink(tmp_path, trainings(first=5))
    sink.write(1, 2048, metrics(0.5))
    sink.close()
    rows = rows_of(tmp_path)
    assert list(rows[0])[:4] == ["iteration", "env_steps", "seed", "episode_return"]
    assert [row["seed"] for row in rows] == ["5", "6"]
    assert [row["option_steps_1"] for row in rows] == ["2", "4"]
    assert [row["episode_return"] for row in rows] == ["", "7"]


def test_the_settings_of_a_sweep_have_columns(tmp_path):
    swept = [Training(5, i, {"algo.gamma": gamma}) for i, gamma in enumerate((0.9, 0.95))]
    CsvSink(tmp_path, swept).write(1, 2048, metrics(0.5))
    CsvSink(tmp_path, swept, resume_after=1).write(2, 4096, metrics(0.5))
    rows = rows_of(tmp_path)
    assert [row["iteration"] for row in rows] == ["1", "1", "2", "2"]
    assert [(row["seed"], row["setting"], row["algo.gamma"]) for row in rows[:2]] == [
        ("5", "0", "0.9"), ("5", "1", "0.95")
    ]  # fmt: skip
    np.testing.assert_array_equal(read_metrics(tmp_path)["algo.gamma"][:, 1], [0.9, 0.95])


def test_resuming_drops_rows_after_the_checkpoint(written):
    sink = CsvSink(written, trainings(), resume_after=2)
    sink.write(3, 30, metrics(33.0))
    sink.close()
    assert [row["a_metric"] for row in rows_of(written)] == ["1", "2", "2", "3", "33", "34"]
    assert not list(written.glob("*.tmp"))


@pytest.mark.parametrize("text", [None, "", "\n\n", "12", "iteration,env_steps,se", "\0\0\0"])
def test_resuming_survives_a_file_that_holds_nothing(tmp_path, text):
    if text is not None:
        (tmp_path / "metrics.csv").write_text(text)
    sink = CsvSink(tmp_path, trainings(), resume_after=2)
    sink.write(3, 30, metrics(3.0))
    sink.close()
    assert [row["iteration"] for row in rows_of(tmp_path)] == ["3", "3"]


DAMAGES = {  # what happens to the file -> how many of its 6 rows it costs
    "a quote": (lambda text: text.replace("2,20,0", '2,"20,0'), 1),
    "a digit": (lambda text: text.replace("2,20,0", "2,2x,0"), 1),
    "the seed": (lambda text: text.replace("2,20,0", "2,20,7"), 1),
    "an end of a line": (lambda text: text.replace("\r\n2,20,1", ";2,20,1"), 1),
    "the header": (lambda text: text.replace("seed", "sead"), 6),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_resuming_keeps_a_damaged_file_and_says_what_it_cost(written, capsys, name):
    damage, cost = DAMAGES[name]
    path = written / "metrics.csv"
    for number in ("", "_2"):
        damaged = damage(path.read_bytes().decode())
        path.write_bytes(damaged.encode())
        sink = CsvSink(written, trainings(), resume_after=3)
        sink.close()
        aside = path.with_name(f"metrics.csv.damaged{number}")
        assert aside.read_bytes().decode() == damaged
        rows = 5 if name == "an end of a line" else 6  # of two rows it makes one
        message = f"{cost} of the {rows} rows of '{path}' cannot be read and are left out; "
        message += aside.name
        assert message in capsys.readouterr().err
        path.write_bytes(damaged.encode())
    assert len(list(written.iterdir())) == 3


def test_rows_belong_to_their_seeds_wherever_they_stand(written):
    """Without a row, those of the other seeds stay, and its report is left out."""
    path = written / "metrics.csv"
    header, *rows = path.read_text().splitlines()
    swapped = [rows[i] for i in (1, 0, 3, 4, 5)]
    path.write_text("".join(f"{line}\n" for line in (header, *swapped)))
    metrics = read_metrics(written)
    np.testing.assert_array_equal(metrics["seed"], [[0, 0], [1, 1]])
    np.testing.assert_array_equal(metrics["a_metric"], [[1, 3], [2, 4]])


@pytest.mark.parametrize("torn", ["12", "2,20", "\n", "2,20,0,5,\0"])
def test_resuming_leaves_a_torn_row_out(written, torn):
    with (written / "metrics.csv").open("a") as file:
        file.write(torn)
    sink = CsvSink(written, trainings(), resume_after=3)
    sink.write(4, 40, metrics(4.0))
    sink.close()
    assert "".join(row["iteration"] for row in rows_of(written)) == "11223344"
    assert read_metrics(written)["a_metric"].shape == (2, 4)
