import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.envs.spec import Box
from hitmdp_jax.networks import OptionNetwork
from hitmdp_jax.networks.option_heads import Head

NETWORK = OptionNetwork(
    actions=Box.unlimited(2), num_options=3, num_values=4, hidden_sizes=(8, 8), activation="tanh"
)


@pytest.fixture(scope="module")
def params():
    @jax.jit
    def init(key):
        params = NETWORK.init(key, jnp.zeros((1, 5)))["params"]
        return params, jax.tree.map(lambda x: x + jax.random.normal(key, x.shape), params)

    return init(jax.random.key(0))


@pytest.fixture
def first_params(params):
    return params[0]


@pytest.fixture
def noisy_params(params):
    return params[1]


@jax.jit
def outputs_of_their_own(params, obs):
    """Each option's outputs [K] of its own networks, by name."""
    return {
        name: [
            Head(size, (8, 8), "tanh").apply(
                {"params": jax.tree.map(lambda x, k=k: x[k], params[name])}, obs
            )
            for k in range(3)
        ]
        for name, size in (("policies", 2), ("terminations", 1))
    }


@jax.jit
def evaluate(params, obs):
    return NETWORK.apply({"params": params}, obs)


@pytest.mark.parametrize("batch_shape", [(), (7,), (2, 3)])
def test_every_options_heads_equal_networks_of_their_own(noisy_params, batch_shape):
    obs = np.random.default_rng(0).normal(size=(*batch_shape, 5))
    heads = evaluate(noisy_params, obs)
    outputs = jax.device_get(outputs_of_their_own(noisy_params, obs))
    for k in range(3):
        mean, termination = np.tanh(outputs["policies"][k]), outputs["terminations"][k][..., 0]
        np.testing.assert_allclose(heads.action[..., k, :], mean, rtol=1e-4)
        np.testing.assert_allclose(heads.termination[..., k], termination, rtol=1e-4, atol=1e-5)
    assert heads.value.shape == (*batch_shape, 4)
    np.testing.assert_allclose(np.exp(heads.log_master).sum(-1), 1.0, rtol=1e-5)


def test_the_policy_of_chosen_options_is_picked_from_all(noisy_params):
    random, option = np.random.default_rng(0), np.array([0, 1, 2, 2, 1, 0])
    obs, action = (random.normal(size=(6, n)).astype(np.float32) for n in (5, 2))

    @jax.jit
    def log_probs(params):
        heads = evaluate(params, obs)
        every = heads.every_policy().log_prob(action[:, None])
        return heads.policy(option).log_prob(action), every

    chosen, every = log_probs(noisy_params)
    np.testing.assert_allclose(chosen, np.asarray(every)[np.arange(6), option], rtol=1e-4)


def test_options_start_with_bodies_of_their_own(first_params):
    kernel = np.asarray(first_params["policies"]["body"]["hidden_1"]["kernel"])
    assert not np.allclose(kernel[0], kernel[1])
    np.testing.assert_allclose(kernel[0] @ kernel[0].T, np.eye(8), atol=1e-5)
