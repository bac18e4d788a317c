import numpy as np
import pytest

from hitmdp_jax.report import plots


@pytest.mark.parametrize(("dt", "unit", "last"), [(0.5, "seconds", 1.0), (None, "step", 2)])
def test_strips_end_with_the_longest_episode(dt, unit, last):
    """Episodes of three steps and of one; what comes after an episode is blank."""
    option = np.array([[2, 1], [0, 1], [0, 1], [1, 1], [1, 1]])
    alive = np.array([[1, 1], [1, 0], [1, 0], [0, 0], [0, 0]], bool)
    shown = plots.strips(option, alive, 3, dt)
    assert shown.layout.xaxis.title.text == unit
    (strip,) = shown.data
    np.testing.assert_array_equal(strip.z, [[2, 0, 0], [1, np.nan, np.nan]])
    assert strip.x[-1] == last


@pytest.mark.parametrize("written", [".2g", None])
def test_a_matrix_tells_its_numbers_where_it_is_asked_to(written):
    shown = plots.matrix(np.eye(2), ["a", "b"], ["c", "d"], 1.0, written=written)
    assert shown.data[0].texttemplate == (written and "%{z:.2g}")


@pytest.mark.parametrize(("signed", "low"), [(True, -3.0), (False, 0.0)])
@pytest.mark.parametrize("size", [6e-5, 2.0])
def test_the_colours_of_a_matrix_end_where_they_are_told_to(size, signed, low):
    shown = plots.matrix(size * np.eye(2), ["a", "b"], ["c", "d"], 3.0, signed=signed)
    assert (shown.data[0].zmin, shown.data[0].zmax) == (low, 3.0)
