"""The pockets: what going straight pays, what going round pays, and where both end."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax import make_env, spec_of
from hitmdp_jax.envs.suites.maze import maps
from hitmdp_jax.envs.suites.maze.maze import GOAL, NEAR, POSITION
from tests.programs import compiled

# The straight way and the way round (m), and the time limit.
POCKETS = {
    "trap/point": (6.0, 12.0, 200),
    "trap/point_long": (24.0, 30.0, 600),
    "trap/ant": (24.0, 48.0, 1000),
    "trap/ant_long": (96.0, 120.0, 3000),
}


def go(env, towards, number):
    """Push the ball in a direction for some steps; return the rewards and the last state."""
    push = compiled(env.step)
    state, rewards = env.reset_to(*env.sample_initial(jax.random.key(0))), []
    for direction, steps in zip(towards, number, strict=True):
        for _ in range(steps):
            state = push(state, jnp.asarray(direction))
            rewards.append(float(state.reward))
            if state.done:
                return rewards, state
    return rewards, state


def shortest_way(rows):
    """Return how many cells the way from S to G has: a search in breadth."""
    (start,), (goal,) = (
        [(i, j) for i, row in enumerate(rows) for j, tile in enumerate(row) if tile == mark]
        for mark in "SG"
    )
    found, edge = {start: 0}, [start]
    while edge:
        i, j = edge.pop(0)
        for step in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            if rows[step[0]][step[1]] != "#" and step not in found:
                found[step] = found[i, j] + 1
                edge.append(step)
    return found[goal]


@pytest.mark.parametrize("name", POCKETS)
def test_start_goal_and_time_limit_are_those_of_the_map(name):
    env = make_env(name, physics="native")
    straight, way_round, limit = POCKETS[name]
    assert spec_of(env).episode_length == limit
    qpos, qvel = compiled(jax.vmap(env.sample_initial))(jax.random.split(jax.random.key(0), 500))
    way = np.asarray(qpos[:, GOAL] - qpos[:, POSITION])
    cell = env.maze.cell
    assert np.ptp(qpos[:, GOAL], axis=0).max() == 0.0
    np.testing.assert_allclose(way.mean(axis=0), [straight, 0.0], atol=0.05 * cell)
    spread = np.abs(way - [straight, 0.0]).max(axis=0)
    assert (spread <= 0.25 * cell + 1e-5).all()
    assert (spread > 0.2 * cell).all()
    assert not np.any(qvel)
    assert shortest_way(env.maze.rows) * cell == way_round


def test_going_straight_earns_the_way_to_the_pockets_end_and_nothing_more():
    env = make_env("trap/point", physics="native")
    rewards, state = go(env, [(1.0, 0.0)], [200])
    x = float(state.pipeline_state.qpos[0])
    assert x == pytest.approx(1.4, abs=0.02)  # a ball's radius before the wall at 1.5
    assert 6.0 - abs(3.0 - x) == pytest.approx(sum(rewards), abs=0.3)
    assert not np.any(np.abs(rewards[100:]) > 1e-3)
    assert not state.done


@pytest.mark.parametrize("reward_type", ["dense", "sparse"])
def test_going_round_earns_the_prize_and_ends_the_episode(reward_type):
    env = make_env("trap/point", physics="native", reward_type=reward_type)
    way = [(0.0, 1.0), (1.0, 0.3), (0.0, -1.0)]
    rewards, state = go(env, way, [40, 60, 60])
    assert (state.done, state.metrics["success"]) == (1.0, 1.0)
    first = np.asarray(env.sample_initial(jax.random.key(0))[0])
    left = np.linalg.norm(state.pipeline_state.qpos[POSITION] - state.pipeline_state.qpos[GOAL])
    gained = np.linalg.norm(first[POSITION] - first[GOAL]) - left
    assert left <= NEAR
    expected = 6.0 + (gained if reward_type == "dense" else 0.0)
    np.testing.assert_allclose(sum(rewards), expected, rtol=1e-4)


def test_the_ball_forgets_a_push_and_has_a_greatest_speed():
    """By the solution of m dv/dt = F - c v, which MuJoCo integrates in steps of 0.01 s."""
    env = make_env("trap/point", physics="native")
    mass, force, damping = 4.18879, 84.0, 16.8  # kg, N, N s/m; joints' damping is implicit
    per_substep = 1.0 / (1.0 + 0.01 * damping / mass)
    state, expected = env.reset_to(*env.sample_initial(jax.random.key(0))), 0.0
    push = compiled(env.step)
    for step in range(12):
        force_now = force if step < 6 else 0.0
        state = push(state, jnp.array([0.0, force_now / force]))
        for _ in range(5):
            expected = (expected + 0.01 * force_now / mass) * per_substep
        np.testing.assert_allclose(state.pipeline_state.qvel[1], expected, rtol=2e-2)
    assert force / damping == 5.0


def test_marks_of_a_map_are_free_and_found():
    maze = maps.Maze(("####", "#SG#", "####"), cell=2.0, height=1.0)
    np.testing.assert_array_equal(maze.centre(maps.START), [-1.0, 0.0])
    np.testing.assert_array_equal(maze.centre(maps.GOAL), [1.0, 0.0])
    assert len(maze.free) == 2
    assert len(maze.walls) == 10
