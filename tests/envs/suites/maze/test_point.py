import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax import make_env
from hitmdp_jax.envs.suites.maze.maps import FOUR_ROOMS
from tests.envs.suites.maze.parity import (
    Oracle,
    as_numbers,
    assert_initial_states_agree,
    assert_limits_agree,
    assert_steps_agree,
)

# Gymnasium-Robotics has no four rooms, but takes a map.
MAZES = {
    "maze/point_umaze": Oracle("PointMaze_UMaze-v3"),
    "maze/point_medium": Oracle("PointMaze_Medium-v3"),
    "maze/point_fourrooms": Oracle("PointMaze_Large-v3", as_numbers(FOUR_ROOMS)),
}
HOW = {"reach": 0.1, "hold": 20}


@pytest.mark.parametrize("name", MAZES)
def test_native_steps_as_gymnasium_robotics(name):
    assert_steps_agree(name, MAZES[name], "native", **HOW)


def test_dense_reward_and_an_end_at_the_goal_are_gymnasium_robotics():
    assert_steps_agree(
        "maze/point_umaze",
        MAZES["maze/point_umaze"],
        "native",
        **HOW,
        reward_type="dense",
        continuing_task=False,
    )


@pytest.mark.parametrize(
    "name",
    [
        "maze/point_umaze",
        *(pytest.param(n, marks=pytest.mark.slow) for n in list(MAZES)[1:]),
    ],
)
def test_mjx_steps_as_gymnasium_robotics(name):
    assert_steps_agree(name, MAZES[name], "mjx", **HOW, num_steps=2)


@pytest.mark.parametrize("name", MAZES)
def test_initial_states_are_gymnasium_robotics(name):
    assert_initial_states_agree(name, MAZES[name])


@pytest.mark.parametrize("name", list(MAZES)[:2])
def test_time_limits_are_gymnasium_robotics(name):
    assert_limits_agree(name, MAZES[name])


def test_success_stays_for_the_rest_of_the_episode_and_the_goal_where_it_is():
    env = make_env("maze/point_umaze", physics="native")
    state = env.reset_to(jnp.array([-1.0, 1.0, 0.0, 1.0]), jnp.zeros(4))
    seen = []
    step = jax.jit(env.step)
    for _ in range(200):
        state = step(state, jnp.array([1.0, 0.0]))
        seen.append((state.reward, state.metrics["success"], *state.pipeline_state.qpos))
    reward, success, x, *_, goal_x, goal_y = np.array(seen).T
    at_goal = np.abs(x) <= 0.45
    np.testing.assert_array_equal(reward, at_goal)
    assert not at_goal[0]
    assert at_goal.any()
    assert not at_goal[-1]  # it went past, to the wall
    assert abs(x[-1] - 1.4) < 0.01
    np.testing.assert_array_equal(success, np.maximum.accumulate(at_goal))
    np.testing.assert_array_equal([goal_x, goal_y], np.array([np.zeros(200), np.ones(200)]))


def test_a_held_action_adds_up_rewards_and_not_success():
    env = make_env("maze/point_umaze", physics="native", action_repeat=4)
    step = jax.jit(env.step)
    state = step(env.reset_to(jnp.array([-1.0, 1.0, -1.0, 1.0]), jnp.zeros(4)), jnp.zeros(2))
    assert (state.reward, state.metrics["success"]) == (4.0, 1.0)
    state = state.replace(
        pipeline_state=state.pipeline_state.replace(qpos=jnp.array([1, 1, -1, 1.0]))
    )
    state = step(state, jnp.zeros(2))
    assert (state.reward, state.metrics["success"]) == (0.0, 1.0)
