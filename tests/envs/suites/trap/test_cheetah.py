"""The cheetah's switch: the body is HalfCheetah's, and the prize needs the switch first."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax import UsageError, make_env, spec_of
from tests.programs import compiled

DISTANCE = 3.0


def at(env, x, touched):
    """Return a state that stands at x, the switch touched or not."""
    qpos = jnp.zeros(9).at[0].set(x)
    state = env.reset_to(qpos, jnp.zeros(9))
    touched = jnp.float32(touched)
    return state.replace(obs=state.obs.at[-1].set(touched), info={"touched": touched})


def test_the_body_moves_and_is_seen_as_half_cheetahs():
    ours = make_env("trap/cheetah_switch", physics="native")
    theirs = make_env(
        "halfcheetah", physics="native", exclude_current_positions_from_observation=False
    )

    @compiled
    def walk(key):
        qpos, qvel = theirs.sample_initial(key)

        def step(states, action):
            states = ours.step(states[0], action), theirs.step(states[1], action)
            return states, (states[0].obs, states[1].obs)

        actions = jax.random.uniform(key, (50, 6), minval=-1.5, maxval=1.5)
        return jax.lax.scan(step, (ours.reset_to(qpos, qvel), theirs.reset_to(qpos, qvel)), actions)

    _, (seen, expected) = walk(jax.random.key(0))
    np.testing.assert_allclose(seen[:, :-1], expected, atol=1e-6)
    np.testing.assert_array_equal(seen[:, -1], 0.0)


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
def test_the_prize_is_paid_at_the_goal_after_the_switch(reward_type, x, touched, after, success):
    env = make_env("trap/cheetah_switch", physics="native", reward_type=reward_type)
    action = jnp.full(6, 0.5)
    before = at(env, x, touched)
    state = compiled(env.step)(before, action)
    assert state.obs[-1] == state.info["touched"] == after
    assert state.metrics["success"] == state.done == success
    way = abs(DISTANCE - x) - abs(DISTANCE - float(state.pipeline_state.qpos[0]))
    dense = way - 0.01 * 6 * 0.25
    expected = 20.0 * success + (dense if reward_type == "dense" else 0.0)
    np.testing.assert_allclose(state.reward, expected, atol=1e-5)


def test_an_episode_begins_with_the_switch_untouched():
    env = make_env("trap/cheetah_switch", physics="native")
    state = compiled(env.reset)(jax.random.key(1))
    assert state.obs[-1] == state.info["touched"] == 0.0


def test_a_lost_simulation_pays_nothing_at_the_goal():
    env = make_env("trap/cheetah_switch", physics="native")
    state = compiled(env.step)(at(env, 3.5, 1), jnp.full(6, jnp.nan))
    assert (state.reward, state.done, state.metrics["success"]) == (0.0, 1.0, 0.0)
    assert state.metrics["unstable"] == 1.0


def test_the_far_switch_is_farther_and_has_more_time():
    env = make_env("trap/cheetah_switch", physics="native", distance=6.0)
    assert spec_of(env).episode_length == 600
    step = compiled(env.step)
    assert step(at(env, -5.0, 0), jnp.zeros(6)).info["touched"] == 0.0
    assert step(at(env, -6.5, 0), jnp.zeros(6)).info["touched"] == 1.0


def test_parts_and_names_say_what_is_where():
    seen = spec_of(make_env("trap/cheetah_switch", physics="native")).observation
    assert (seen.names[0], seen.names[-1], seen.size) == ("rootx position", "switch touched", 19)
    assert [seen.entries_of([part]).tolist() for part in ("place", "goal")] == [[0], [18]]
    assert seen.entries_of(["body"]).tolist() == list(range(1, 18))


def test_a_distance_must_be_positive():
    with pytest.raises(UsageError, match=r"distance = 0\.0"):
        make_env("trap/cheetah_switch", physics="native", distance=0.0)
