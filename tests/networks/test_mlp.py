import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.networks.mlp import MLP, orthogonal


def test_inputs_act_as_if_concatenated(key):
    state, option = jax.random.normal(key, (5, 3)), jax.random.normal(key, (5, 2))
    params = MLP((8, 4)).init(key, state, option)
    layers = params["params"]
    kernel = jnp.concatenate([layers["input_0"]["kernel"], layers["input_1"]["kernel"]])
    hidden = jnp.concatenate([state, option], axis=-1) @ kernel + layers["input_0"]["bias"]
    hidden = jnp.maximum(hidden, 0) @ layers["hidden_1"]["kernel"] + layers["hidden_1"]["bias"]
    np.testing.assert_allclose(
        MLP((8, 4)).apply(params, state, option), jnp.maximum(hidden, 0), rtol=1e-5, atol=1e-6
    )


def test_inputs_broadcast_to_every_option(key):
    state, options = jax.random.normal(key, (5, 3)), jnp.eye(4)
    mlp = MLP((8, 6))
    params = mlp.init(key, state[:, None], options)
    every = mlp.apply(params, state[:, None], options)
    assert every.shape == (5, 4, 6)
    for k in range(4):
        one = mlp.apply(params, state, jnp.tile(options[k], (5, 1)))
        np.testing.assert_allclose(every[:, k], one, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("shape", [(64, 64), (17, 64), (64, 6)])
def test_initial_kernels_are_orthogonal(key, shape):
    kernel = orthogonal(2.0)(key, shape)
    gram = kernel @ kernel.T if shape[0] <= shape[1] else kernel.T @ kernel
    np.testing.assert_allclose(gram, 4.0 * np.eye(min(shape)), atol=1e-4)


def test_vmapped_initialisation_equals_one_seed_at_a_time(key):
    keys = jax.random.split(key, 3)
    init = functools.partial(orthogonal(1.0), shape=(8, 8))
    together = jax.vmap(init)(keys)
    for one, k in zip(together, keys, strict=True):
        np.testing.assert_allclose(one, init(k), atol=1e-6)


@pytest.mark.timeout(120)
@pytest.mark.parametrize("num_seeds", [4, 10])
def test_compiled_initialisation_of_many_seeds_does_not_hang(key, num_seeds):
    """Batches of QR factorisations starve XLA's thread pool on two cores: see `orthogonal`."""
    mlp = MLP((64, 64, 64, 64))
    init = jax.jit(jax.vmap(lambda k: mlp.init(k, jnp.zeros((1, 17)), jnp.zeros((1, 40)))))
    params = jax.block_until_ready(init(jax.random.split(key, num_seeds)))
    assert jax.tree.leaves(params)[0].shape[0] == num_seeds
