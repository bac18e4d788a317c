"""A simulation that MuJoCo loses ends its own episode, is counted, and harms no other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mujoco.batch import Batch, SimulationError

from hitmdp_jax import make_env
from hitmdp_jax.envs.vector import VectorEnv

NUM_ENVS = 8
LOST = 3


@pytest.fixture(
    scope="module",
    params=[
        ("halfcheetah", "native"),
        ("ant", "native"),
        pytest.param(("dmc/cartpole_balance", "mjx"), marks=pytest.mark.whole),
    ],
)
def batch(request):
    """Return the compiled step, the states of 8 environments and their actions."""
    name, physics = request.param
    env = make_env(name, physics=physics)
    states = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), NUM_ENVS))
    actions = jax.random.uniform(jax.random.key(1), (NUM_ENVS, env.action_size), minval=-1.0)
    return jax.jit(jax.vmap(env.step)), states, actions


def with_fault(states, field, value):
    data = states.pipeline_state
    broken = getattr(data, field).at[LOST, 0].set(value)
    return states.replace(pipeline_state=data.replace(**{field: broken}))


def assert_only_one_is_lost(after, healthy):
    np.testing.assert_array_equal(after.metrics["unstable"], np.arange(NUM_ENVS) == LOST)
    assert after.done[LOST] == 1
    assert after.reward[LOST] == 0
    assert np.isfinite(after.obs).all()
    assert all(np.isfinite(term).all() for term in after.metrics.values())
    others = np.arange(NUM_ENVS) != LOST
    np.testing.assert_array_equal(after.obs[others], healthy.obs[others])
    np.testing.assert_array_equal(after.reward[others], healthy.reward[others])
    np.testing.assert_array_equal(after.done[others], healthy.done[others])


@pytest.mark.parametrize(
    ("field", "value"), [("qpos", jnp.nan), ("qvel", jnp.nan), ("qvel", jnp.inf), ("qvel", 1e12)]
)
def test_lost_state_ends_its_own_episode_only(batch, field, value):
    step, states, actions = batch
    after = step(with_fault(states, field, value), actions)
    assert_only_one_is_lost(after, step(states, actions))


def test_action_that_is_not_a_number_ends_its_own_episode_only(batch):
    step, states, actions = batch
    after = step(states, actions.at[LOST, 0].set(jnp.nan))
    assert_only_one_is_lost(after, step(states, actions))
    # The last good state stays, so whoever does not reset can go on.
    again = step(after, actions)
    assert not again.metrics["unstable"].any()


def test_infinite_action_is_clipped_like_any_other(batch):
    step, states, actions = batch
    np.testing.assert_array_equal(
        step(states, actions.at[LOST, 0].set(jnp.inf)).obs,
        step(states, actions.at[LOST, 0].set(1.0)).obs,
    )


def test_simulation_in_which_mujoco_raises_is_lost_alone(monkeypatch):
    env = make_env("hopper", physics="native")
    states = jax.vmap(env.reset)(jax.random.split(jax.random.key(0), NUM_ENVS))
    actions = jnp.zeros((NUM_ENVS, env.action_size))
    healthy = jax.vmap(env.step)(states, actions)
    run = Batch.step

    def step_and_raise(batch, **kwargs):
        run(batch, **kwargs)
        raise SimulationError(np.array([LOST]), "out of memory")

    monkeypatch.setattr(Batch, "step", step_and_raise)
    assert_only_one_is_lost(jax.vmap(env.step)(states, actions), healthy)


def test_vector_env_restarts_a_lost_simulation():
    env = VectorEnv(make_env("hopper", physics="native"), NUM_ENVS, pool_size=4)
    state = env.reset(jax.random.key(0))
    state = state.replace(env=with_fault(state.env, "qpos", jnp.nan))
    step = jax.jit(env.step)
    for expected_lost in (1, 0, 0):
        state, seen = step(state, jnp.zeros((NUM_ENVS, env.env.action_size)))
        assert seen.metrics["unstable"].sum() == expected_lost
        assert bool(seen.terminated[LOST]) == bool(expected_lost)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(state))
