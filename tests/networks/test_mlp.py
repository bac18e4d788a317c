import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.networks.mlp import MLP, orthogonal


def test_state_and_option_act_as_if_concatenated(key):
    random = np.random.default_rng(0)
    state, vectors = (random.normal(size=(5, n)).astype(np.float32) for n in (3, 2))
    option = np.array([4, 0, 0, 2, 1])
    mlp = MLP((8, 4))
    output, params = jax.jit(lambda key: mlp.init_with_output(key, state, vectors, option))(key)
    layers = jax.device_get(params["params"])
    kernel = np.concatenate([layers["input_0"]["kernel"], layers["input_1"]["kernel"]])
    hidden = np.concatenate([state, vectors[option]], axis=-1) @ kernel + layers["input_0"]["bias"]
    hidden = np.maximum(hidden, 0) @ layers["hidden_1"]["kernel"] + layers["hidden_1"]["bias"]
    np.testing.assert_allclose(output, np.maximum(hidden, 0), rtol=1e-5, atol=1e-6)


def test_states_broadcast_to_every_option(key):
    state, vectors = np.random.default_rng(0).normal(size=(5, 3)), np.eye(4)
    mlp = MLP((8, 6))

    @jax.jit
    def evaluate(key):
        every, params = mlp.init_with_output(key, state[:, None], vectors, np.arange(4))
        return every, [mlp.apply(params, state, vectors, np.full(5, k)) for k in range(4)]

    every, alone = evaluate(key)
    assert every.shape == (5, 4, 6)
    for k in range(4):
        np.testing.assert_allclose(every[:, k], alone[k], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("shape", [(64, 64), (17, 64), (64, 6)])
def test_initial_kernels_are_orthogonal(key, shape):
    kernel = np.asarray(jax.jit(lambda key: orthogonal(2.0)(key, shape))(key))
    gram = kernel @ kernel.T if shape[0] <= shape[1] else kernel.T @ kernel
    np.testing.assert_allclose(gram, 4.0 * np.eye(min(shape)), atol=1e-4)


def test_vmapped_initialisation_equals_one_seed_at_a_time(key):
    init = functools.partial(orthogonal(1.0), shape=(8, 8))

    @jax.jit
    def both(key):
        keys = jax.random.split(key, 3)
        return jax.vmap(init)(keys), jnp.stack([init(k) for k in keys])

    np.testing.assert_allclose(*both(key), atol=1e-6)


@pytest.mark.parametrize("num_seeds", [4, 10])
def test_compiled_initialisation_of_many_seeds_does_not_hang(key, num_seeds):
    """Batches of QR factorisations starve XLA's thread pool on two cores: see `orthogonal`."""
    mlp = MLP((64, 64, 64, 64))
    init = jax.jit(jax.vmap(lambda k: mlp.init(k, jnp.zeros((1, 17)))))
    params = jax.block_until_ready(init(jax.random.split(key, num_seeds)))
    assert jax.tree.leaves(params)[0].shape[0] == num_seeds
