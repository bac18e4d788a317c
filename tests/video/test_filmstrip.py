from types import SimpleNamespace

import numpy as np

from hitmdp_jax.interpret.visited_states import visited
from hitmdp_jax.video.filmstrip import THUMBNAIL, evenly, filmstrip, poses
from hitmdp_jax.video.pictures import painter_of


def test_pictures_are_spread_evenly():
    np.testing.assert_array_equal(evenly(np.arange(16)), [1, 3, 5, 7, 9, 11, 13, 15])
    np.testing.assert_array_equal(evenly(np.array([3, 9])), [3, 9])


def test_a_filmstrip_has_a_row_an_option_with_the_times_of_its_steps(env, recorded):
    figure = filmstrip(env, recorded)
    rows = [figure.axes[i : i + 8] for i in (0, 8, 16)]
    times = {
        row[0].get_ylabel().split("\n")[0]: [axes.get_xlabel() for axes in row if axes.images]
        for row in rows
    }
    assert figure.axes[0].get_ylabel() == "option 0\n40% of steps\n2.0 at a time"
    # Steps 0, 1, 2 and 5 under option 0, of 0.04 s each.
    assert times == {
        "option 0": ["0.00 s", "0.04 s", "0.08 s", "0.20 s"],
        "option 1": ["0.24 s", "0.28 s", "0.32 s", "0.36 s"],
        "option 2": ["0.12 s", "0.16 s"],
    }


def test_a_filmstrip_without_options_is_of_the_whole_episode(env, recorded):
    figure = filmstrip(env, recorded.replace(option=None))
    times = [float(axes.get_xlabel().split()[0]) for axes in figure.axes]
    assert len(times) == 8
    assert (times[0], times[-1]) == (0.0, 0.36)


def test_poses_are_pictures_of_the_typical_states(env, recorded):
    """Of option 2 the fifth step, of 3 the second one of the other episode."""
    analysis = SimpleNamespace(
        env=env, trajectories=recorded, states=visited(recorded), typical={2: 4, 3: 11}
    )
    found = poses(analysis)  # type: ignore
    with painter_of(env, THUMBNAIL) as painter:
        wanted = {2: painter.paint([-0.1, 0.0], [1, 1]), 3: painter.paint([-0.7, 0.0], [1, 1])}
    assert found.keys() == wanted.keys()
    for k, picture in wanted.items():
        np.testing.assert_array_equal(found[k], picture)
