"""A rollout against the environment's and the agent's own account of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.learning.normalization import initial_statistics, normalize, update_statistics
from hitmdp_jax.learning.rollout import RolloutState, collect
from tests.probes import Counter
from tests.programs import compiled

T, B = 12, 3  # episodes of 5 steps
normal = compiled(normalize)


class Counting:
    """Remembers how often it acted since the episode began; its action is the clock it sees."""

    def initial_memory(self, key, batch_shape=()):
        return jnp.zeros(batch_shape, jnp.int32)

    def act(self, params, obs, memory, key, deterministic=False):
        return params * obs[..., :1], memory + 1, {"acted": memory, "noise": jax.random.bits(key)}


@pytest.fixture(scope="module")
def statistics():
    obs = np.random.default_rng(0).normal(1.0, 2.0, (100, 2))
    return compiled(lambda obs: update_statistics(initial_statistics(2), obs))(obs)


@pytest.fixture(scope="module")
def rollout(statistics):
    env = VectorEnv(Counter(), B, pool_size=16, stagger=False)

    @compiled
    def run(key):
        state = RolloutState(env.reset(key), Counting().initial_memory(key, (B,)))
        return collect(Counting(), jnp.ones(()), statistics, env, state, key, T)

    return run(jax.random.key(0))


def test_the_memory_starts_anew_with_each_episode(rollout):
    _, batch, _ = rollout
    clock = np.arange(T) % 5
    np.testing.assert_array_equal(batch.memory, np.repeat(clock[:, None], B, axis=1))
    np.testing.assert_array_equal(batch.record["acted"], batch.memory)
    np.testing.assert_array_equal(batch.obs[..., 0], batch.memory)
    np.testing.assert_array_equal(batch.started, batch.memory == 0)
    np.testing.assert_array_equal(batch.truncated, batch.memory == 4)


def test_the_next_observation_is_the_one_reached_before_the_reset(rollout, statistics):
    _, batch, _ = rollout
    reached = batch.obs + np.array([1.0, 0.0])  # also where the time limit ended the episode
    np.testing.assert_array_equal(batch.next_obs, reached)
    seen = batch.normalized().next_obs
    np.testing.assert_allclose(seen, normal(reached, statistics), rtol=1e-5, atol=1e-6)


def test_agents_see_normalised_observations_and_statistics_wait(rollout, statistics):
    _, batch, _ = rollout
    seen = batch.normalized()
    np.testing.assert_allclose(seen.obs, normal(batch.obs, statistics), rtol=1e-5)
    np.testing.assert_allclose(batch.action, seen.obs[..., :1], rtol=1e-5)
    np.testing.assert_array_equal(seen.normalized().obs, seen.obs)


def test_the_next_rollout_goes_on_where_this_one_stopped(rollout):
    state, batch, _ = rollout
    np.testing.assert_array_equal(state.memory, batch.memory[-1] + 1)
    np.testing.assert_array_equal(state.env.env.obs[:, 0], state.memory)


def test_every_step_has_a_key_of_its_own(rollout):
    noise = rollout[1].record["noise"]
    assert len(np.unique(noise)) == T
