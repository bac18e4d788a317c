import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import norm

from hitmdp_jax.networks import ActionDecoder, Critic


def test_action_density_equals_scipy(key):
    obs, option = jax.random.normal(key, (5, 3)), jax.random.normal(key, (5, 4))
    decoder = ActionDecoder(action_size=2, initial_log_std=-0.3)
    params = decoder.init(key, obs, option)
    policy = decoder.apply(params, obs, option)
    action = jax.random.normal(key, (5, 2))
    expected = norm.logpdf(action, policy.mode(), np.exp(-0.3)).sum(-1)
    np.testing.assert_allclose(policy.log_prob(action), expected, rtol=1e-5)
    np.testing.assert_allclose(policy.entropy(), 2 * norm.entropy(scale=np.exp(-0.3)), rtol=1e-5)


def test_first_actions_are_nearly_centred(key):
    obs = jax.random.normal(key, (256, 3))
    decoder = ActionDecoder(action_size=2)
    mean = decoder.apply(decoder.init(key, obs), obs).mode()
    assert np.abs(mean).max() < 0.1


def test_critic_of_every_option_equals_one_at_a_time(key):
    obs = jax.random.normal(key, (5, 3))
    critic = Critic()
    params = critic.init(key, obs, jnp.zeros((5, 4)))
    every = critic.apply(params, obs[:, None], jnp.eye(4))
    assert every.shape == (5, 4)
    for k in range(4):
        one_hot = jnp.tile(jnp.eye(4)[k], (5, 1))
        np.testing.assert_allclose(every[:, k], critic.apply(params, obs, one_hot), rtol=1e-5)
