import jax
import numpy as np

from hitmdp_jax import make_env
from hitmdp_jax.envs.vector import VectorEnv


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
