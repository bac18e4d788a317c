import numpy as np
import pytest

from hitmdp_jax.figures.scores import intervals, profiles
from hitmdp_jax.figures.style import styles

LOOKS = styles({"mopg": "mopg", "ppo": "ppo", "ppo-held": "ppo"})
SCORES = [np.array([3.0, 1.0, 2.0, np.nan]), np.array([5.0]), np.array([np.nan])]


def test_a_profile_falls_from_one_to_none_at_every_seed_that_has_a_return():
    lines = profiles(LOOKS, SCORES).axes[0].lines
    np.testing.assert_allclose(lines[0].get_xydata(), [[1, 1], [2, 2 / 3], [3, 1 / 3], [3, 0]])
    np.testing.assert_allclose(lines[1].get_xydata(), [[5, 1], [5, 0]])
    assert not len(lines[2].get_xydata())


@pytest.mark.parametrize("longest", [3, 300])
def test_an_interval_is_drawn_where_it_is_known_whatever_a_run_is_called(longest):
    looks = styles({"a" * longest: "mopg", "ppo": "ppo"})
    figure = intervals(looks, SCORES[:2], [2.0, 5.0], [[1.0, 3.0], [np.nan, np.nan]])
    figure.draw_without_rendering()
    seeds, interval, middle = figure.axes[0].lines[:3]
    np.testing.assert_array_equal(seeds.get_xdata(), SCORES[0])
    assert (list(interval.get_xdata()), list(middle.get_xdata())) == ([1.0, 3.0], [2.0])
    assert figure.axes[0].get_yticklabels()[1].get_text() == "ppo (n = 1)"
