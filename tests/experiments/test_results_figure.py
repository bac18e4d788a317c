"""Published curves as a figure, against a plain reading of their files."""

import csv

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from hitmdp_jax.cli.published import read_cells
from hitmdp_jax.experiments import experiment
from hitmdp_jax.experiments.published import Cell
from hitmdp_jax.experiments.results_figure import figure
from hitmdp_jax.experiments.results_page import shown, used_options
from hitmdp_jax.interpret.summary import Summary
from hitmdp_jax.runs.config import RunConfig
from tests.cli.conftest import CHECKOUT

RESULTS = CHECKOUT / "results"
PUBLISHED = [name for name in experiment.names() if (RESULTS / f"{name}.png").is_file()]


def test_a_panel_shows_the_mean_of_every_published_arm():
    table1 = experiment.read("table1")
    drawn = figure(shown(table1, read_cells(RESULTS, table1.tasks)))
    assert drawn is not None
    titles = dict(axes.get_title().split(": ") for axes in drawn.axes)
    panels = dict(zip(titles, drawn.axes, strict=True))
    assert {"halfcheetah", "swimmer", "humanoidstandup", "reacher"} == set(panels)
    assert titles["swimmer"] == "10 or 16 seeds"
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == list(table1.arms)
    (line,) = [x for x in panels["swimmer"].lines if x.get_label() == "ppo"]
    with (RESULTS / "swimmer" / "curves.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["arm"] == "ppo"]
    last = [float(row[str(i)]) for row in rows[-3:] for i in range(1, 17)]
    x, y = (np.asarray(values, float) for values in line.get_data())
    assert x[-1] == float(rows[-1]["env_steps"])
    np.testing.assert_allclose(y[-1], np.mean(last))


@pytest.mark.parametrize("name", PUBLISHED)
def test_no_text_of_a_figure_is_cut(name):
    known = experiment.read(name)
    drawn = figure(shown(known, read_cells(RESULTS, known.tasks)))
    assert drawn is not None
    FigureCanvasAgg(drawn).draw()
    texts = [*drawn.legends, *drawn.texts, *(axes.title for axes in drawn.axes)]
    for text in texts:
        extent = text.get_window_extent()
        assert drawn.bbox.contains(extent.x0, extent.y0), text
        assert drawn.bbox.contains(extent.x1, extent.y1), text


def test_what_is_not_published_is_not_drawn(tmp_path):
    assert figure(read_cells(tmp_path, ["swimmer"])) is None


SWEPT = RunConfig(
    algo={"name": "mopg", "num_options": 4},
    seeds=3,
    sweep={"algo.entropy_weight": [0.01, 0.2]},
    total_steps=2048,
)


def test_the_options_that_each_setting_of_a_sweep_uses_are_counted():
    columns = {
        "seed": np.array([0.0, 1.0, 2.0] * 2),
        "setting": np.repeat([0.0, 1.0], 3),
        "algo.entropy_weight": np.repeat([0.01, 0.2], 3),
        "options_used": np.array([1.0, 2.0, 2.0, 4.0, 4.0, 2.0]),
    }
    run = Summary(SWEPT, columns)
    assert used_options(run, run.by_setting()) == [
        ["entropy_weight", "1 option", "2 options", "3 options", "4 options"],
        ["0.01", "1", "2", "0", "0"],
        ["0.2", "0", "1", "0", "2"],
    ]
    drawn = figure({"task": {"arm": Cell(run, {})}})
    assert drawn is not None
    (axes,) = drawn.axes
    heights = [[bar.get_height() for bar in group] for group in axes.containers]
    assert heights == [[1, 0], [2, 1], [0, 0], [0, 2]]
    assert axes.get_xlabel() == "entropy_weight"
