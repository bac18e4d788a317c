import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from hitmdp_jax import make_env
from hitmdp_jax.envs.suites.gym.half_cheetah import HalfCheetah
from hitmdp_jax.errors import UsageError
from hitmdp_jax.physics.warp import WarpPhysics, in_one_call

NUM_ENVS = 256


@pytest.fixture(scope="module")
def fallen():
    """Return states of cheetahs that have fallen on the floor, and actions."""
    env = make_env("halfcheetah", physics="native")
    states = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), NUM_ENVS))
    actions = jax.random.uniform(jax.random.key(1), (20, NUM_ENVS, env.action_size), minval=-1.0)
    step = jax.jit(jax.vmap(env.step))
    for action in actions:
        states = step(states, action)
    return states, actions[0]


@pytest.mark.whole
def test_contacts_of_many_worlds_all_have_room(fallen):
    """Where they had not, cheetahs fell through the floor: velocities were off by 6.5."""
    states, action = fallen
    ours = jax.jit(jax.vmap(make_env("halfcheetah", physics="warp").step))(states, action)
    theirs = jax.jit(jax.vmap(make_env("halfcheetah", physics="native").step))(states, action)
    error = np.abs(ours.pipeline_state.qvel - theirs.pipeline_state.qvel).max(axis=-1)
    assert np.quantile(error, 0.9) < 2e-4
    assert error.max() < 1e-2


@pytest.mark.whole
def test_a_world_has_room_for_every_contact(fallen):
    """A cheetah in the floor has more than MJX's budget keeps, and takes more iterations."""
    states, action = jax.tree.map(lambda x: x[:4], fallen)
    flat = states.pipeline_state.qpos.at[:, 1].set(-0.5).at[:, 2:].set(0.0)
    states = states.replace(pipeline_state=states.pipeline_state.replace(qpos=flat))
    envs = [make_env("halfcheetah", physics=engine) for engine in ("warp", "native")]
    data = mujoco.MjData(envs[1].model)
    data.qpos[:] = flat[0]
    mujoco.mj_forward(envs[1].model, data)
    assert data.ncon > HalfCheetah.mjx_budget.contacts
    ours, theirs = (jax.jit(jax.vmap(env.step))(states, action).pipeline_state for env in envs)
    np.testing.assert_allclose(ours.qvel, theirs.qvel, atol=1e-3)


@pytest.mark.whole
def test_a_training_steps_on_warp_as_each_seed_alone(fallen):
    """Seeds and environments are two maps around a step; their worlds share one list."""
    states, action = jax.tree.map(lambda x: x[:6].reshape(2, 3, *x.shape[1:]), fallen)
    env = make_env("halfcheetah", physics="warp")
    both = jax.jit(jax.vmap(jax.vmap(env.step)))(states, action)
    alone = jax.jit(jax.vmap(env.step))(*jax.tree.map(lambda x: x[1], (states, action)))
    np.testing.assert_allclose(both.obs[1], alone.obs, atol=1e-5)


def test_every_map_ends_up_in_one_call():
    calls = []

    def function(rows):
        calls.append({name: x.shape for name, x in rows.items()})
        return {"sum": rows["x"].sum(axis=-1) + rows["y"]}

    row = in_one_call(function)
    x, y = jnp.arange(24.0).reshape(2, 3, 4), jnp.arange(3.0)
    nested = jax.vmap(jax.vmap(lambda x, y: row({"x": x, "y": y})), in_axes=(0, None))
    np.testing.assert_array_equal(nested(x, y)["sum"], x.sum(axis=-1) + y)
    assert calls[-1] == {"x": (6, 4), "y": (6,)}  # y, which one map leaves out, is repeated
    np.testing.assert_array_equal(row({"x": x[0, 0], "y": y[2]})["sum"], x[0, 0].sum() + 2.0)
    assert calls[-1] == {"x": (1, 4), "y": (1,)}
    thrice = jax.vmap(jax.vmap(jax.vmap(lambda x: row({"x": x, "y": y[1]}))))
    ones = jnp.ones((2, 5, 7, 4))
    np.testing.assert_array_equal(thrice(ones)["sum"], np.full((2, 5, 7), 5.0))
    assert calls[-1] == {"x": (70, 4), "y": (70,)}


def test_one_call_may_be_looped_and_compiled():
    row = in_one_call(lambda rows: rows + 1.0)
    looped = jax.jit(jax.vmap(lambda x: jax.lax.scan(lambda c, _: (row(c), None), x, length=3)[0]))
    np.testing.assert_array_equal(looped(jnp.zeros((4, 2))), np.full((4, 2), 3.0))


def test_a_model_of_its_own_for_each_episode_is_refused():
    """Warp has one for all worlds. Its physics need not be built for that to be said."""
    with pytest.raises(UsageError, match="a task that draws its own in each episode needs mjx or"):
        WarpPhysics.complete(None, {"geom_friction": None})  # pyright: ignore
