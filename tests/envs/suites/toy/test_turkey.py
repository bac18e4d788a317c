import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml

import hitmdp_jax
from hitmdp_jax.agents import MOPG, PPO
from hitmdp_jax.cli.settings import configs
from hitmdp_jax.envs.suites.toy.turkey import Turkey
from tests.programs import OPTIMIZED

STUFF, ROAST = jnp.array([-1.0]), jnp.array([1.0])
PLAY = {
    "stuff, then roast": ([STUFF, ROAST], [0.0, 10.0], [0.0, 1.0]),
    "roast at once": ([ROAST], [-10.0], [1.0]),
    "stuff for ever": ([STUFF, STUFF], [0.0, 0.0], [0.0, 1.0]),
}


@pytest.mark.parametrize("case", PLAY)
def test_rewards_and_ends(case, key):
    actions, rewards, dones = PLAY[case]
    env = Turkey()
    state = env.reset(key)
    for action, reward, done in zip(actions, rewards, dones, strict=True):
        state = env.step(state, action)
        assert (float(state.reward), float(state.done)) == (reward, done)


def test_the_camera_does_not_see_the_stuffing(key):
    env = Turkey()
    raw = env.reset(key)
    np.testing.assert_array_equal(env.step(raw, STUFF).obs, raw.obs)
    assert not np.array_equal(env.step(raw, ROAST).obs, raw.obs)


@pytest.mark.slow
def test_mopg_learns_to_stuff_then_roast_and_ppo_cannot():
    """App. A. Without memory the best return is 0: -10 p + 10 p (1 - p) for roasting with p.

    A third of the tuned steps is enough for most seeds; one that finds it shows that it can.
    """
    tuned = yaml.safe_load((configs() / "tuned" / "toy" / "turkey-mopg.yaml").read_text())
    sizes = {"num_steps": tuned["total_steps"] // 3, "rollout_length": tuned["rollout_length"]}
    keys = jax.random.split(jax.random.key(0), 6)
    returns = {}
    for agent in (MOPG(**tuned["algo"]), PPO(learning_rate=1e-3, num_epochs=4)):
        train = jax.vmap(lambda k, a=agent: hitmdp_jax.train(a, Turkey(), k, **sizes))
        train = jax.jit(train, compiler_options=OPTIMIZED)
        history = np.asarray(train(keys)[1]["episode_return"])
        returns[type(agent)] = history[:, -5:].mean(axis=1)
    assert (returns[MOPG] > 9.5).sum() >= 2
    assert (returns[PPO] < 0.5).all()
