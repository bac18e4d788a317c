import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from hitmdp_jax.learning.optimization import adam, adapted_share, minibatch_epochs


def test_adam_equals_optax_on_the_tree():
    params = {"a": np.ones((3, 2)), "b": np.arange(4.0)}
    grads = jax.tree.map(lambda x: 3.0 * x + 1.0, params)
    reference = optax.chain(optax.clip_by_global_norm(0.5), optax.adam(3e-4, eps=1e-5))
    optimizer = adam(3e-4, 0.5, 1e-5)

    @jax.jit
    def both(params, grads):
        state, expected_state = optimizer.init(params), reference.init(params)
        for _ in range(3):
            updates, state = optimizer.update(grads, state, params)
            expected, expected_state = reference.update(grads, expected_state, params)
        return updates, expected

    updates, expected = both(params, grads)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-5), updates, expected)


def test_every_epoch_sees_every_sample_once(key):
    def loss(params, data):
        # The gradient wrt params is the one-hot count of the samples seen.
        return (params * jax.nn.one_hot(data["index"], 12).sum(0)).sum(), {"n": jnp.ones(())}

    params, _, diagnostics = jax.jit(
        lambda key: minibatch_epochs(
            loss,
            optax.sgd(1.0),
            jnp.zeros(12),
            optax.sgd(1.0).init(jnp.zeros(12)),
            {"index": jnp.arange(12)},
            key,
            num_epochs=5,
            minibatch_size=4,
        )
    )(key)
    np.testing.assert_array_equal(params, -5.0 * np.ones(12))
    assert diagnostics["n"] == 1


@pytest.mark.parametrize("target", [0.002, 0.02])
def test_the_share_of_the_rate_brings_the_kl_to_its_target(target):
    share = jnp.ones(())
    for _ in range(40):
        share = adapted_share(share, 0.08 * share**2, target)
    np.testing.assert_allclose(0.08 * share**2, target, rtol=0.01)


@pytest.mark.parametrize(
    ("kl", "target"), [(0.01, 0.02), (0.0, 0.02), (1.0, jnp.inf), (0.0, jnp.inf)]
)
def test_the_share_of_the_rate_is_the_whole_of_it_while_the_kl_is_small(kl, target):
    assert adapted_share(jnp.ones(()), jnp.asarray(kl), target) == 1.0


@pytest.mark.parametrize("kl", [1e3, jnp.inf])
def test_one_wild_update_no_more_than_halves_the_rate(kl):
    assert adapted_share(jnp.ones(()), jnp.asarray(kl), 0.02) == 0.5
