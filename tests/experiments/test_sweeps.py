import csv
import dataclasses
import io
import re

import numpy as np
import pytest
from rich.console import Console

from hitmdp_jax.cli.jobs import final_return
from hitmdp_jax.experiments.pages import comparison_page
from hitmdp_jax.experiments.sweeps import draw_sweep
from hitmdp_jax.figures.sweeps import ranking
from hitmdp_jax.interpret.summary import Summary
from hitmdp_jax.report.run_report import RunReport
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.sinks import CsvSink
from hitmdp_jax.runs.sinks.terminal import TerminalSink
from tests.report.shown import shown

CONFIG = RunConfig(
    algo={"name": "ppo"}, seeds=2, sweep={"algo.gamma": [0.9, 0.95, 0.99]}, total_steps=3 * 2048
)


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


def test_the_figure_shows_every_setting():
    columns = {"env_steps": np.full(2, 6144.0), "last_100k_steps": np.array([5.0, 7.0])}
    settings = {"gamma=0.95": Summary(CONFIG, columns), "gamma=0.9": Summary(CONFIG, columns)}
    (axes,) = ranking(settings, "a sweep", "mopg").axes
    assert axes.get_xlabel().startswith("return of all 6,144 steps: each of 2 seeds")
    assert [x.get_text() for x in axes.get_yticklabels()] == ["gamma=0.95", "gamma=0.9"]
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), [5.0, 7.0])


TOLD = np.array([[0.0, 2.0], [100.0, 104.0]])  # a worse setting and a better one, of two seeds
TWO = dataclasses.replace(CONFIG, env={"name": "hopper"}, sweep={"algo.gamma": [0.9, 0.99]})


def told_by_a_final_return(run_dir):
    return f"{final_return(run_dir, TWO):.1f} of 2 seeds"


def told_by_the_report(run_dir):
    return "".join(RunReport(run_dir, TWO, "", 0, shown()).summary())


def told_by_a_comparison(run_dir):
    page = comparison_page({"ppo": (run_dir, TWO)}, {"ppo": ""}, {})
    assert '<th scope="row">ppo, gamma=0.9</th><td>2</td>' in page
    (row,) = re.findall(r"<tr><th.*?>(ppo, gamma=0.99</th>.*?)</tr>", page)
    return row.replace("<td>2</td>", "2 seeds")


def told_by_the_terminal(run_dir):
    out = io.StringIO()
    sink = TerminalSink(2048, TWO.trainings)
    sink._console = Console(file=out, width=500)
    values = {"steps_per_second": np.ones(4), "diverged": np.zeros(4), "a_kl": TOLD.ravel() / 100}
    sink.write(1, 2048, values | {"recent_return": TOLD.ravel()})
    shown = "  ".join(f"{name} {value}" for name, value in sink._facts())  # where there is one
    assert "KL a 1.020" in shown
    assert "over 2 seeds, best of 2: gamma=0.99" in out.getvalue()
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
