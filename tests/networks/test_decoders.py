import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

from hitmdp_jax.envs.spec import Box
from hitmdp_jax.networks import ActionDecoder, Critic


@pytest.fixture
def random():
    return np.random.default_rng(0)


def test_action_density_equals_scipy(key, random):
    obs, vectors, action = (random.normal(size=(5, n)).astype(np.float32) for n in (3, 4, 2))
    option = np.arange(5)
    decoder = ActionDecoder(Box.unlimited(2), initial_log_std=-0.3)

    @jax.jit
    def evaluate(key):
        policy = decoder.apply(decoder.init(key, obs, vectors, option), obs, vectors, option)
        return policy.mode(), policy.log_prob(action), policy.entropy()

    mode, log_prob, entropy = evaluate(key)
    expected = norm.logpdf(action, mode, np.exp(-0.3)).sum(-1)
    np.testing.assert_allclose(log_prob, expected, rtol=1e-5)
    np.testing.assert_allclose(entropy, 2 * norm.entropy(scale=np.exp(-0.3)), rtol=1e-5)


def test_first_actions_are_nearly_centred(key, random):
    obs = random.normal(size=(256, 3))
    decoder = ActionDecoder(Box.unlimited(2))
    mean = jax.jit(lambda key: decoder.apply(decoder.init(key, obs), obs).mode())(key)
    assert np.abs(mean).max() < 0.1


def test_critic_of_every_option_equals_one_at_a_time(key, random):
    obs, critic = random.normal(size=(5, 3)), Critic()

    @jax.jit
    def evaluate(key):
        params = critic.init(key, obs, jnp.eye(4), jnp.zeros(5, int))
        alone = [critic.apply(params, obs, jnp.eye(4), jnp.full(5, k)) for k in range(4)]
        return critic.apply(params, obs[:, None], jnp.eye(4), jnp.arange(4)), alone

    every, alone = evaluate(key)
    assert every.shape == (5, 4)
    for k in range(4):
        np.testing.assert_allclose(every[:, k], alone[k], rtol=1e-5)
