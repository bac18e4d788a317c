"""Every maze steps, ends and starts as Gymnasium-Robotics' of that kind."""

import pytest

from hitmdp_jax.envs.suites.maze.maps import FOUR_ROOMS
from tests.envs.suites.gym.parity import MjxWithEllipticCones
from tests.envs.suites.maze.parity import (
    Oracle,
    as_numbers,
    assert_initial_states_agree,
    assert_limits_agree,
    assert_steps_agree,
)

ANT = "maze/ant_umaze"
MAZES = {
    "maze/point_umaze": Oracle("PointMaze_UMaze-v3"),
    "maze/point_medium": Oracle("PointMaze_Medium-v3"),
    # Gymnasium-Robotics has no four rooms, but takes a map.
    "maze/point_fourrooms": Oracle("PointMaze_Large-v3", as_numbers(FOUR_ROOMS)),
    ANT: Oracle("AntMaze_UMaze-v5"),
}
MJX_BY_DEFAULT = "maze/point_umaze"  # stands for all
OF_THE_BALL, OF_THE_ANT = {"reach": 0.1, "hold": 20}, {"reach": 0.9, "hold": 1}


def how(name):
    """Return how states are found in which a robot touches walls."""
    return OF_THE_ANT if name == ANT else OF_THE_BALL


@pytest.mark.parametrize("name", MAZES)
def test_native_steps_as_gymnasium_robotics(name):
    assert_steps_agree(name, MAZES[name], "native", **how(name))


@pytest.mark.parametrize(
    ("name", "keywords"),
    [("maze/point_umaze", {}), (ANT, {"include_cfrc_ext_in_observation": False})],
)
def test_dense_reward_and_an_end_at_the_goal_are_gymnasium_robotics(name, keywords):
    keywords = keywords | {"reward_type": "dense", "continuing_task": False}
    assert_steps_agree(name, MAZES[name], "native", **how(name), **keywords)


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=() if n == MJX_BY_DEFAULT else pytest.mark.slow) for n in MAZES],
)
def test_mjx_steps_as_gymnasium_robotics(name):
    if name == ANT:
        engine = MjxWithEllipticCones(full_budget=True)
        loose = {"num_steps": 1, "tolerance": 2e-3, "share": 0.9}
    else:
        engine, loose = "mjx", {"num_steps": 2}
    assert_steps_agree(name, MAZES[name], engine, **how(name), **loose)


@pytest.mark.parametrize("name", MAZES)
def test_initial_states_are_gymnasium_robotics(name):
    assert_initial_states_agree(name, MAZES[name])


@pytest.mark.parametrize("name", [name for name in MAZES if MAZES[name].maze_map is None])
def test_time_limits_are_gymnasium_robotics(name):
    assert_limits_agree(name, MAZES[name])
