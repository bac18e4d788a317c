"""Published curves as a figure, against a plain reading of their files."""

import csv

import numpy as np

from hitmdp_jax.cli import suites
from hitmdp_jax.experiments.results_figure import figure
from tests.cli.conftest import CHECKOUT

RESULTS = CHECKOUT / "results"


def test_a_panel_shows_the_mean_of_every_published_arm():
    suite = suites.read("table1")
    drawn = figure(suite, RESULTS)
    assert drawn is not None
    titles = dict(axes.get_title().split(": ") for axes in drawn.axes)
    panels = dict(zip(titles, drawn.axes, strict=True))
    assert {"halfcheetah", "swimmer", "humanoidstandup", "reacher"} == set(panels)
    assert titles["swimmer"] == "10 or 16 seeds"
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == list(suite.arms)
    (line,) = [x for x in panels["swimmer"].lines if x.get_label() == "ppo"]
    with (RESULTS / "swimmer" / "ppo" / "curve.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    steps = sorted({float(row["env_steps"]) for row in rows})
    last = [float(row["episode_return"]) for row in rows if float(row["env_steps"]) in steps[-3:]]
    x, y = (np.asarray(values, float) for values in line.get_data())
    assert x[-1] == steps[-1]
    assert len(last) == 3 * 16
    np.testing.assert_allclose(y[-1], np.mean(last))


def test_what_is_not_published_is_not_drawn(tmp_path):
    assert figure(suites.read("table1"), tmp_path) is None
