import jax
import numpy as np
import pytest

from hitmdp_jax import make_env
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.envs.vector import VectorEnv

NUM_ENVS = 4


@pytest.mark.whole
def test_brax_environment_runs_through_episodes_of_its_own():
    env = make_env("brax/inverted_pendulum", backend="spring")
    assert env.backend == "spring"
    assert spec_of(env).episode_length == 1000
    vector_env = VectorEnv(env, NUM_ENVS, pool_size=16)

    @jax.jit
    def run(key):
        def step(state, key):
            action = jax.random.uniform(key, (NUM_ENVS, env.action_size), minval=-1.0)
            return vector_env.step(state, action)

        return jax.lax.scan(step, vector_env.reset(key), jax.random.split(key, 200))[1]

    seen = run(jax.random.key(0))
    assert seen.next_obs.shape == (200, NUM_ENVS, env.observation_size)
    assert np.isfinite(seen.next_obs).all()
    assert seen.terminated.any(axis=0).all()
    # An episode restarts in a new state, not in the first one.
    after = seen.next_obs[1:][np.asarray(seen.terminated[:-1])]
    assert len(np.unique(after, axis=0)) == len(after)
