import pytest

from tests.envs.suites.gym.parity import MjxWithEllipticCones
from tests.envs.suites.maze.parity import (
    Oracle,
    assert_initial_states_agree,
    assert_limits_agree,
    assert_steps_agree,
)

NAME, ORACLE = "maze/ant_umaze", Oracle("AntMaze_UMaze-v5")
HOW = {"reach": 0.9, "hold": 1}


def test_native_steps_as_gymnasium_robotics():
    assert_steps_agree(NAME, ORACLE, "native", **HOW)


def test_dense_reward_and_an_end_at_the_goal_are_gymnasium_robotics():
    assert_steps_agree(
        NAME,
        ORACLE,
        "native",
        **HOW,
        reward_type="dense",
        continuing_task=False,
        include_cfrc_ext_in_observation=False,
    )


@pytest.mark.slow
def test_mjx_steps_as_gymnasium_robotics_with_elliptic_cones():
    engine = MjxWithEllipticCones(full_budget=True)
    assert_steps_agree(NAME, ORACLE, engine, **HOW, num_steps=1, tolerance=2e-3, share=0.9)


def test_initial_states_are_gymnasium_robotics():
    assert_initial_states_agree(NAME, ORACLE)


def test_time_limit_is_gymnasium_robotics():
    assert_limits_agree(NAME, ORACLE)
