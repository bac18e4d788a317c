"""The switches: the body is the robot's, and the prize needs the switch first."""

from pathlib import Path

import gymnasium
import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from hitmdp_jax import UsageError, make_env, spec_of
from tests.programs import compiled

DISTANCE = 3.0
ACTION_COST = {"trap/cheetah_switch": 0.01, "trap/ant_switch": 0.0}
ASSETS = Path(gymnasium.__file__).parent / "envs/mujoco/assets"


def at(env, x, touched):
    """Return a state that stands at x, the switch touched or not."""
    qpos = jnp.asarray(env.model.qpos0, jnp.float32).at[0].set(x)
    state = env.reset_to(qpos, jnp.zeros(env.model.nv))
    touched = jnp.float32(touched)
    return state.replace(obs=state.obs.at[-1].set(touched), info={"touched": touched})


@pytest.mark.parametrize(
    ("name", "asset"),
    [("trap/cheetah_switch", "half_cheetah.xml"), ("trap/ant_switch", "ant.xml")],
)
def test_the_body_moves_and_is_seen_as_mujocos_own_loop_says(name, asset):
    env = make_env(name, physics="native")
    model = mujoco.MjModel.from_xml_path(str(ASSETS / asset))
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER  # the cheetah's own, not the ant's
    data = mujoco.MjData(model)
    actions = np.random.default_rng(0).uniform(-1.5, 1.5, (50, model.nu)).astype(np.float32)

    @compiled
    def walk(key):
        start = env.reset_to(*env.sample_initial(key))

        def step(state, action):
            state = env.step(state, action)
            return state, state.obs

        return start.obs, jax.lax.scan(step, start, actions)[1]

    first, seen = walk(jax.random.key(0))
    np.testing.assert_array_equal(seen[:, -1], np.minimum.accumulate(seen[:, 0]) <= -DISTANCE)
    for action, before, after in zip(actions, [first, *seen[:-1]], seen, strict=True):
        data.qpos[:], data.qvel[:] = np.split(before[:-1], [model.nq])
        data.ctrl[:] = np.clip(action, -1.0, 1.0)
        mujoco.mj_step(model, data, 5)
        expected = np.concatenate([data.qpos, data.qvel])
        np.testing.assert_allclose(after[:-1], expected, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("name", ACTION_COST)
@pytest.mark.parametrize("reward_type", ["dense", "sparse"])
@pytest.mark.parametrize(
    ("x", "touched", "after", "success"),
    [
        (2.5, 0, 0, 0),
        (3.5, 0, 0, 0),  # the goal does not count yet
        (-2.5, 0, 0, 0),
        (-3.5, 0, 1, 0),
        (-2.5, 1, 1, 0),  # touched once is touched for good
        (2.5, 1, 1, 0),
        (3.5, 1, 1, 1),
    ],
)
def test_the_prize_is_paid_at_the_goal_after_the_switch(
    name, reward_type, x, touched, after, success
):
    env = make_env(name, physics="native", reward_type=reward_type)
    action = jnp.full(env.action_size, 0.5)
    before = at(env, x, touched)
    state = compiled(env.step)(before, action)
    assert state.obs[-1] == state.info["touched"] == after
    assert state.metrics["success"] == state.done == success
    way = abs(DISTANCE - x) - abs(DISTANCE - float(state.pipeline_state.qpos[0]))
    dense = way - ACTION_COST[name] * env.action_size * 0.25
    expected = 20.0 * success + (dense if reward_type == "dense" else 0.0)
    np.testing.assert_allclose(state.reward, expected, atol=1e-5)


@pytest.mark.parametrize("name", ACTION_COST)
def test_an_episode_begins_with_the_switch_untouched(name):
    env = make_env(name, physics="native")
    state = compiled(env.reset)(jax.random.key(1))
    assert state.obs[-1] == state.info["touched"] == 0.0


@pytest.mark.parametrize("name", ACTION_COST)
def test_a_lost_simulation_pays_nothing_at_the_goal(name):
    env = make_env(name, physics="native")
    state = compiled(env.step)(at(env, 3.5, 1), jnp.full(env.action_size, jnp.nan))
    assert (state.reward, state.done, state.metrics["success"]) == (0.0, 1.0, 0.0)
    assert state.metrics["unstable"] == 1.0


@pytest.mark.parametrize(
    ("name", "limit"), [("trap/cheetah_switch", 600), ("trap/ant_switch", 1200)]
)
def test_the_far_switch_is_farther_and_has_more_time(name, limit):
    env = make_env(name, physics="native", distance=6.0)
    assert spec_of(env).episode_length == limit
    step = compiled(env.step)
    still = jnp.zeros(env.action_size)
    assert step(at(env, -5.0, 0), still).info["touched"] == 0.0
    assert step(at(env, -6.5, 0), still).info["touched"] == 1.0


@pytest.mark.parametrize(
    ("name", "first", "size", "places"),
    [
        ("trap/cheetah_switch", "rootx position", 19, 1),
        ("trap/ant_switch", "root x position", 30, 2),
    ],
)
def test_parts_and_names_say_what_is_where(name, first, size, places):
    seen = spec_of(make_env(name, physics="native")).observation
    assert (seen.names[0], seen.names[-1], seen.size) == (first, "switch touched", size)
    assert seen.entries_of(["place"]).tolist() == list(range(places))
    assert seen.entries_of(["goal"]).tolist() == [size - 1]
    assert seen.entries_of(["body"]).tolist() == list(range(places, size - 1))


def test_a_distance_must_be_positive():
    with pytest.raises(UsageError, match=r"distance = 0\.0"):
        make_env("trap/cheetah_switch", physics="native", distance=0.0)
