import jax
import jax.numpy as jnp
import numpy as np

import hitmdp_jax
from hitmdp_jax.agents import PPO
from hitmdp_jax.training.sweep import devices_for, place, sweep

SIZES = {"num_envs": 4, "rollout_length": 16}


def test_seeds_are_shared_out_evenly():
    assert len(jax.local_devices()) == 2
    assert [len(devices_for(n)) for n in (1, 2, 3, 10)] == [1, 2, 1, 2]


def test_sharded_seeds_equal_seeds_on_one_device():
    env = hitmdp_jax.make_env("invertedpendulum", physics="native")
    program = hitmdp_jax.make_train(PPO(num_epochs=1), env, num_steps=64, **SIZES)
    keys = jax.vmap(jax.random.key)(jnp.arange(4))
    results = []
    for devices in (jax.local_devices()[:1], jax.local_devices()):
        init, step = sweep(*program, devices)
        state, metrics = step(init(place(keys, devices)))
        results.append((jax.tree.leaves(state.learner), metrics["action_kl"]))
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-5), *results)
