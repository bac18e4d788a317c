"""The forest plot, from cells whose probabilities are known."""

import numpy as np

from hitmdp_jax.experiments.forest import forest
from tests.experiments.test_results_page import EXPERIMENT, cell

CELLS = {
    "hopper": {"mopg": cell(3.0, 4.0), "ppo": cell(1.0, 2.0), "dac": cell(0.0, 0.0)},
    "ant": {"mopg": cell(1.0, 1.0), "ppo": cell(1.0, 1.0)},
}


def test_each_arm_stands_where_it_is_beaten_as_often_as_it_is():
    """Three quarters on two tasks; an arm with one task in common is left out."""
    drawn = forest({"which": EXPERIMENT}, CELLS)
    (panel,) = drawn.axes
    assert panel.get_title(loc="left") == "Which?"
    assert [label.get_text() for label in panel.get_yticklabels()] == ["ppo"]
    level, *_ = panel.lines
    np.testing.assert_array_equal(level.get_xdata(), [0.5, 0.5])
    ((x, y),) = panel.containers[0].lines[0].get_xydata()
    assert (x, y) == (0.75, 0.0)
    np.testing.assert_allclose(panel.containers[0].lines[2][0].get_segments()[0][:, 0], 0.75)


def test_nothing_in_common_is_no_plot():
    assert forest({"which": EXPERIMENT}, {"hopper": CELLS["hopper"]}) is None
