import jax
import numpy as np
import pytest

from hitmdp_jax import make_env
from hitmdp_jax.envs import check_env
from hitmdp_jax.errors import UsageError
from tests.envs.suites.gym.oracle import GymnasiumTask
from tests.envs.suites.parity import (
    assert_near,
    oracle_steps,
    our_steps,
    random_actions,
    random_states,
)

POSITIONS = {"halfcheetah": 8, "walker2d": 8, "hopper": 5, "swimmer": 3, "invertedpendulum": 2}


@pytest.mark.parametrize("name", POSITIONS)
def test_observation_is_gymnasiums_without_its_velocities_and_all_else_is_the_same(name):
    oracle = GymnasiumTask(name)
    env = make_env(name, physics="native", hide_velocities=True)
    qpos, qvel = random_states(oracle, num_states=20)
    actions = random_actions(oracle, (2, len(qpos)), np.random.default_rng(1))
    desired = oracle_steps(oracle, qpos, qvel, actions)
    actual = our_steps(env, qpos, qvel, actions)
    assert env.observation_size == POSITIONS[name]
    for step in range(2):
        shown = desired.obs[step, :, : POSITIONS[name]]
        assert_near(actual.obs[step], shown, 1e-3, 1.0, "observation")
        assert_near(actual.reward[step], desired.reward[step], 1e-3, 1.0, "reward")
    np.testing.assert_array_equal(actual.terminated, desired.terminated)


def test_velocities_that_are_hidden_are_simulated_all_the_same():
    env = make_env("halfcheetah", physics="native", hide_velocities=True)
    rest = env.reset_to(env.model.qpos0, np.zeros(env.model.nv))
    flying = env.reset_to(env.model.qpos0, np.ones(env.model.nv))
    np.testing.assert_array_equal(rest.obs, flying.obs)
    step = jax.jit(env.step)
    assert not np.allclose(step(rest, np.zeros(6)).obs, step(flying, np.zeros(6)).obs)


@pytest.mark.parametrize("name", ["humanoid", "toy/turkey", "dmc/walker_walk"])
def test_other_tasks_say_that_they_cannot(name):
    with pytest.raises(UsageError, match=f"Unknown keyword of {name} 'hide_velocities'"):
        check_env(name, hide_velocities=True)
