"""What the ants of all traps have in common."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from hitmdp_jax import make_env
from tests.programs import compiled

ANTS = ["trap/ant", "trap/ant_long", "trap/ant_switch"]


@pytest.mark.parametrize("name", ANTS)
def test_an_ant_on_its_back_ends_the_episode(name):
    env = make_env(name, physics="native")
    step = compiled(env.step)
    still = jnp.zeros(env.action_size)
    for degrees, fallen in ((0, 0), (80, 0), (100, 1), (180, 1)):
        half = np.deg2rad(degrees) / 2
        for axis in (4, 5):  # of qpos: the quaternion's x and y, a roll and a pitch
            qpos = jnp.asarray(env.model.qpos0, jnp.float32).at[2].set(3.0)  # in the air
            qpos = qpos.at[3].set(np.cos(half)).at[axis].set(np.sin(half)).at[15:].set(50.0)
            state = step(env.reset_to(qpos, jnp.zeros(env.model.nv)), still)
            assert (state.done, state.metrics["success"]) == (fallen, 0.0)


@pytest.mark.parametrize("name", ANTS)
def test_an_ants_motion_is_integrated_by_eulers_method(name):
    env = make_env(name, physics="native")
    assert env.model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert make_env("ant", physics="native").model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4


@pytest.mark.parametrize("name", ANTS)
def test_options_are_paid_for_staying_on_their_feet_and_the_task_pays_nothing(name):
    env = make_env(name, physics="native", reward_type="sparse")
    state = compiled(env.reset)(jax.random.key(0))
    after = compiled(env.step)(state, jnp.zeros(env.action_size))
    paid = compiled(env.option_rewards)(state, jnp.zeros(env.action_size), after)
    x, y = (after.pipeline_state.qpos - state.pipeline_state.qpos)[:2] / 0.05
    np.testing.assert_allclose([paid["east"], paid["north"]], [1.0 + x, 1.0 + y], atol=1e-3)
    assert after.reward == 0.0
