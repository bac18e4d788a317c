import jax
import jax.numpy as jnp
import numpy as np

from hitmdp_jax import make_env


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
