import jax
import numpy as np
import pytest

from hitmdp_jax import make_env
from hitmdp_jax.envs.vector import VectorEnv
from tests.envs.suites.dmc.parity import (
    Oracle,
    assert_initial_states_agree,
    assert_steps_agree,
    random_states,
)

TASKS = {
    "dmc/reacher_easy": Oracle("reacher", "easy", drawn_geom="target"),
    "dmc/reacher_hard": Oracle("reacher", "hard", drawn_geom="target"),
}


def states_near_the_target(oracle):
    """Move each state's target to where it is about to touch the finger, or just not."""
    qpos, qvel = random_states(oracle)
    env, rng = oracle.load(), np.random.default_rng(2)
    env.reset()
    for row in range(len(qpos)):
        oracle.set_state(env, qpos[row], qvel[row])
        env.physics.forward()
        reach = env.physics.named.model.geom_size[["target", "finger"], 0].sum()
        finger = env.physics.named.data.geom_xpos["finger", :2]
        qpos[row, 2:] = finger + rng.uniform(-1.2 * reach, 1.2 * reach, 2)
    return qpos, qvel


@pytest.mark.parametrize("name", TASKS)
def test_native_steps_as_the_suite(name):
    assert_steps_agree(name, TASKS[name], "native", states=states_near_the_target(TASKS[name]))


@pytest.mark.parametrize(
    "name", ["dmc/reacher_easy", pytest.param("dmc/reacher_hard", marks=pytest.mark.slow)]
)  # which differ in the reward alone, and each is a program of its own to compile
def test_mjx_steps_as_the_suite(name):
    states = states_near_the_target(TASKS[name])
    assert_steps_agree(name, TASKS[name], "mjx", num_steps=1, states=states)


def test_initial_states_are_the_suites():
    assert_initial_states_agree("dmc/reacher_easy", TASKS["dmc/reacher_easy"])


def test_every_environment_and_episode_has_its_own_target_which_stays():
    env = VectorEnv(make_env("dmc/reacher_easy", physics="native"), 4, 8, episode_length=3)
    state = env.reset(jax.random.key(0))
    step = jax.jit(env.step)
    targets, ended = [], []
    for _ in range(6):
        targets.append(np.asarray(state.env.pipeline_state.qpos[:, 2:]))
        state, seen = step(state, np.ones((4, 2), np.float32))
        ended.append(np.asarray(seen.truncated))
    targets, ended = np.array(targets), np.array(ended)
    assert len(np.unique(targets[0], axis=0)) == 4
    moved = (targets[1:] != targets[:-1]).any(axis=-1)
    np.testing.assert_array_equal(moved, ended[:-1])
