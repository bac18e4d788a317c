"""What tasks pay to options: names, values and who checks them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import Env, State

from hitmdp_jax import UsageError, make_env
from hitmdp_jax.agents import MOPG
from hitmdp_jax.envs.option_rewards import ALONG, COMPASS, directions_of, option_reward_names
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.training.program import make_train
from tests.programs import compiled

OFFERED = {
    "halfcheetah": ALONG,
    "walker2d": ALONG,
    "invertedpendulum": ALONG,
    "dmc/cheetah_run": ALONG,
    "trap/cheetah_switch": ALONG,
    "trap/ant_switch": COMPASS,
    "ant": COMPASS,
    "humanoid": COMPASS,
    "swimmer": COMPASS,
    "maze/ant_umaze": COMPASS,
    "trap/point": COMPASS,
    "reacher": (),
    "dmc/reacher_easy": (),
}


class Walk(Env):
    """A walk on the integers, with rewards for options of its own."""

    observation_size, action_size, backend = 1, 1, "none"

    def reset(self, rng):
        zero = jnp.zeros((), jnp.float32)
        return State(None, jnp.zeros(1), zero, zero, {}, {})

    def step(self, state, action):
        return state.replace(obs=state.obs + jnp.sign(action), reward=jnp.float32(7.0))

    def option_rewards(self, before, action, after):
        right = (after.obs - before.obs)[0]
        return {"right": right, "left": -right, "effort": jnp.abs(action).sum()}


@pytest.mark.parametrize("name", OFFERED)
def test_bodies_offer_the_directions_in_which_their_roots_move(name):
    names, along = directions_of(make_env(name, physics="native").model)
    assert names == OFFERED[name]
    # Each is a direction of length 1, and the opposite one has the opposite sign.
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 1.0, rtol=1e-6)
    half = len(names) // 2
    np.testing.assert_allclose(along[:half], -along[half:], atol=1e-12)


@pytest.mark.parametrize(("name", "angle"), [("trap/point", 0), ("trap/point", 90), ("ant", 45)])
def test_a_velocity_is_the_way_gone_in_a_second(name, angle):
    env = make_env(name, physics="native")

    @compiled
    def walk(key):
        before = env.reset(key)
        # The engine's own displacement has the way of the last step alone.
        after = env.step(before, jnp.full(env.action_size, 0.7))
        return before, after, env.option_rewards(before, jnp.zeros(env.action_size), after)

    before, after, paid = walk(jax.random.key(0))
    way = np.asarray(after.pipeline_state.qpos - before.pipeline_state.qpos)[:2]
    direction = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    # Positions are in float32, up to 4 m here.
    expected = way @ direction / env.dt
    np.testing.assert_allclose(paid[COMPASS[angle // 45]], expected, atol=1e-4)
    assert abs(expected) > 1e-3


def test_steps_pay_what_was_asked_for_in_that_order_and_before_a_restart():
    env = VectorEnv(Walk(), 2, 4, 3, stagger=False, option_rewards=("left", "task", "effort"))
    state = env.reset(jax.random.key(0))
    step = compiled(env.step)
    for _ in range(4):  # the third ends the episode, whose next observation is 0
        state, outcome = step(state, jnp.array([[2.0], [-3.0]]))
        np.testing.assert_array_equal(outcome.option_reward, [[-1, 7, 2], [1, 7, 3]])


def test_nothing_is_paid_unless_asked_for():
    env = VectorEnv(Walk(), 2, 4, 3)
    _, outcome = jax.eval_shape(env.step, env.reset(jax.random.key(0)), jnp.ones((2, 1)))
    assert outcome.option_reward is None


def test_names_of_a_task_of_ones_own():
    assert option_reward_names(Walk()) == ("effort", "left", "right", "task")
    assert option_reward_names(make_env("toy/cue")) == ("task",)


@pytest.mark.parametrize(
    ("env", "name", "sentence"),
    [
        (Walk(), "rihgt", "did you mean 'right'"),
        (make_env("reacher", physics="native"), "forward", "task"),
        (make_env("toy/cue"), "forward", "task"),
    ],
)
def test_a_reward_that_the_task_does_not_offer_is_refused_by_name(env, name, sentence):
    agent = MOPG(option_rewards=("task", name))
    with pytest.raises(UsageError, match="option reward") as raised:
        make_train(agent, env, num_steps=64, num_envs=1, rollout_length=64)
    assert name in str(raised.value)
    assert sentence in str(raised.value)
