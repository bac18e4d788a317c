"""The paths of robots: where they went, in whose colour, and what lies around."""

import functools

import jax
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from hitmdp_jax import UsageError, make_env, spec_of
from hitmdp_jax.agents import MOPG
from hitmdp_jax.figures.registry import find
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from tests.interpret.analyses import analysis_of_embeddings
from tests.probes import untrained_policy


@functools.cache
def analysis(name):
    env = make_env(name, physics="native")
    agent = MOPG(num_options=3, hidden_sizes=(8,), similarity=0.0).bind(spec_of(env))
    policy = jax.jit(lambda key: untrained_policy(agent, key))(jax.random.key(0))
    return OptionAnalysis(policy, env, jax.random.key(1), 2)


def drawn(name):
    (axes,) = find("paths").draw(analysis(name)).axes
    return axes, [x for x in axes.collections if isinstance(x, LineCollection)]


def test_a_ball_in_a_maze_is_seen_from_above():
    axes, paths = drawn("trap/point")
    found = analysis("trap/point").trajectories
    assert len(paths) == 2
    for n, path in enumerate(paths):
        alive = found.alive[:, n]
        place, option = found.qpos[alive, n, :2], found.option[alive, n]
        segments = np.array(path.get_segments())
        np.testing.assert_allclose(segments[:, 0], place[:-1], atol=1e-6)
        np.testing.assert_allclose(segments[:, 1], place[1:], atol=1e-6)
        colors = [to_hex(color) for color in path.get_colors()]
        assert colors == [option_color(k) for k in option[:-1]]
    walls = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    assert len(walls) == len(analysis("trap/point").env.maze.walls)
    (goal,) = (line.get_xydata()[0] for line in axes.lines if line.get_marker() == "*")
    np.testing.assert_allclose(goal, [3.0, 0.0])


def test_a_runners_place_is_drawn_against_the_step():
    axes, paths = drawn("trap/cheetah_switch")
    found = analysis("trap/cheetah_switch").trajectories
    assert axes.get_xlabel() == "step"
    segments = np.array(paths[0].get_segments())
    np.testing.assert_allclose(segments[:, 0, 1], found.qpos[:-1, 0, 0], atol=1e-6)
    np.testing.assert_array_equal(segments[:, 0, 0], np.arange(len(segments)))
    levels = [line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == ":"]
    assert sorted(levels) == [-3.0, 3.0]  # the switch and the goal
    assert {text.get_text() for text in axes.texts} == {"switch", "goal"}


def test_what_has_no_path_says_so():
    with pytest.raises(UsageError, match="no MuJoCo model"):
        find("paths").draw(analysis_of_embeddings())
    with pytest.raises(UsageError, match="stays in one place"):
        find("paths").draw(analysis("reacher"))
