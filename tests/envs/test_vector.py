import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.wrappers.training import EpisodeWrapper

from hitmdp_jax.envs.action_repeat import ActionRepeat
from hitmdp_jax.envs.vector import VectorEnv
from tests.probes import Counter, Target
from tests.programs import compiled


@functools.partial(compiled, static_argnums=(0, 1))
def run(env, steps, key, action=0.0):
    """Return the states and outcomes of `steps` steps, each stacked [steps, B]."""

    def step(state, _):
        new, outcome = env.step(state, jnp.full((env.num_envs, 1), action))
        return new, (new, outcome)

    return jax.lax.scan(step, env.reset(key), length=steps)[1]


COUNTERS = VectorEnv(Counter(), 2, pool_size=8, stagger=False)


def test_time_limit_truncates_and_does_not_terminate(key):
    _, outcome = run(COUNTERS, 12, key)
    np.testing.assert_array_equal(outcome.truncated[:, 0], np.arange(1, 13) % 5 == 0)
    assert not outcome.terminated.any()


def test_final_observation_is_the_one_before_the_reset(key):
    states, outcome = run(COUNTERS, 12, key)
    np.testing.assert_array_equal(outcome.next_obs[:5, 0, 0], [1, 2, 3, 4, 5])
    np.testing.assert_array_equal(states.env.obs[:5, 0, 0], [1, 2, 3, 4, 0])


def test_termination_is_kept_apart_from_truncation(key):
    env = VectorEnv(Target(), 3, pool_size=64)
    _, outcome = run(env, 4, key)
    assert outcome.terminated.all()
    assert not outcome.truncated.any()


def test_termination_at_the_time_limit_is_a_termination(key):
    env = VectorEnv(Counter(), 1, pool_size=4, stagger=False)
    _, outcome = run(env, 5, key, action=200.0)
    assert outcome.terminated.all()
    assert not outcome.truncated.any()


@pytest.mark.parametrize(("action", "truncates"), [(0.0, True), (200.0, False)])
@pytest.mark.parametrize("hold", [1, 3], ids=["", "held"])
def test_an_end_by_a_time_limit_of_the_tasks_own_truncates(key, action, truncates, hold):
    """As Brax's `EpisodeWrapper` and MuJoCo Playground tell it: `done`, and why in `info`."""
    task = EpisodeWrapper(Counter(), episode_length=3, action_repeat=1)
    env = task if hold == 1 else ActionRepeat(task, hold)
    _, outcome = run(VectorEnv(env, 2, pool_size=8, stagger=False), 6, key, action)
    ends = np.arange(1, 7) % (3 if hold == 1 and truncates else 1) == 0
    np.testing.assert_array_equal(outcome.truncated[:, 0], ends & truncates)
    np.testing.assert_array_equal(outcome.terminated[:, 0], ends & (not truncates))


def test_every_episode_starts_from_a_new_state(key):
    states, _ = run(VectorEnv(Counter(), 4, pool_size=16, stagger=False), 20, key)
    serials = np.asarray(states.env.obs[4::5, :, 1])  # after each reset
    assert len(np.unique(serials)) == serials.size == 16


def test_refilling_gives_new_states(key):
    env = VectorEnv(Counter(), 4, pool_size=16)
    state = env.reset(key)
    refilled = env.refill(state, jax.random.key(7))
    assert not np.isin(refilled.pool.obs[:, 1], state.pool.obs[:, 1]).any()


def test_returns_are_reported_at_the_end_of_whole_episodes(key):
    _, outcome = run(COUNTERS, 12, key)
    np.testing.assert_array_equal(outcome.finished[:, 0], np.arange(1, 13) % 5 == 0)
    assert set(outcome.episode_return[outcome.finished].tolist()) == {5.0}
    assert set(outcome.episode_length[outcome.finished].tolist()) == {5}


def test_staggered_first_episodes_are_shorter_and_not_reported(key):
    _, outcome = run(VectorEnv(Counter(), 64, pool_size=512, stagger=True), 10, key)
    ended = np.asarray(outcome.terminated | outcome.truncated)
    assert ended[:4].any()
    assert ended.any(axis=1).mean() > 0.8  # ends are spread over time
    assert set(outcome.episode_length[outcome.finished].tolist()) == {5}


def test_vmapped_seeds_equal_one_at_a_time(key):
    env = VectorEnv(Counter(), 3, pool_size=8)
    keys = jax.random.split(key, 2)
    _, together = jax.vmap(lambda k: run(env, 8, k))(keys)
    for i in range(2):
        _, alone = run(env, 8, keys[i])
        jax.tree.map(lambda x, y, i=i: np.testing.assert_allclose(x[i], y), together, alone)
