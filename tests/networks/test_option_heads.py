import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.networks import OptionNetwork
from hitmdp_jax.networks.option_heads import Head

NETWORK = OptionNetwork(
    action_size=2, num_options=3, num_values=4, hidden_sizes=(8, 8), activation="tanh"
)


@pytest.fixture
def params(key):
    params = NETWORK.init(key, jnp.zeros((1, 5)))["params"]
    return jax.tree.map(lambda x: x + jax.random.normal(key, x.shape), params)


@pytest.mark.parametrize("batch_shape", [(), (7,), (2, 3)])
def test_every_options_heads_equal_networks_of_their_own(key, params, batch_shape):
    obs = jax.random.normal(key, (*batch_shape, 5))
    heads = NETWORK.apply({"params": params}, obs)
    for k in range(3):
        for name, size in (("policies", 2), ("terminations", 1)):
            own = jax.tree.map(lambda x, k=k: x[k], params[name])
            output = Head(size, (8, 8), "tanh").apply({"params": own}, obs)
            if name == "policies":
                np.testing.assert_allclose(heads.mean[..., k, :], jnp.tanh(output), rtol=1e-4)
            else:
                np.testing.assert_allclose(
                    heads.termination[..., k], output[..., 0], rtol=1e-4, atol=1e-5
                )
    assert heads.value.shape == (*batch_shape, 4)
    np.testing.assert_allclose(jnp.exp(heads.log_master).sum(-1), 1.0, rtol=1e-5)


def test_the_policy_of_chosen_options_is_picked_from_all(key, params):
    obs, option = jax.random.normal(key, (6, 5)), jnp.array([0, 1, 2, 2, 1, 0])
    heads = NETWORK.apply({"params": params}, obs)
    action = jax.random.normal(key, (6, 2))
    every = heads.every_policy().log_prob(action[:, None])
    np.testing.assert_allclose(
        heads.policy(option).log_prob(action), every[jnp.arange(6), option], rtol=1e-4
    )


def test_options_start_with_bodies_of_their_own(key):
    kernel = NETWORK.init(key, jnp.zeros((1, 5)))["params"]["policies"]["body"]["hidden_1"][
        "kernel"
    ]
    assert not np.allclose(kernel[0], kernel[1])
    np.testing.assert_allclose(kernel[0] @ kernel[0].T, np.eye(8), atol=1e-5)
