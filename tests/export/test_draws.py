import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.errors import UsageError
from hitmdp_jax.export.draws import without_key

X = jnp.arange(3.0)


def split(function):
    """A function whose noise is handed over, and what noise it is."""
    pure, noise = without_key(jax.make_jaxpr(function)(jax.random.key(0), X))
    return pure, [(each.distribution, each.shape.shape) for each in noise]


def test_what_is_drawn_is_handed_over_in_order():
    def function(key, x):
        first, second, third = jax.random.split(key, 3)
        option = jax.random.categorical(first, x)
        stop = jax.random.uniform(second, (3,)) < 0.3
        return option, stop, x + 2.0 * jax.random.normal(third, (1, 3))[0]

    pure, noise = split(function)
    assert noise == [("gumbel", (3,)), ("uniform", (3,)), ("normal", (3,))]
    key = jax.random.key(7)
    first, second, third = jax.random.split(key, 3)
    draws = jax.random.gumbel(first, (3,)), jax.random.uniform(second, (3,))
    found = pure(X, *draws, jax.random.normal(third, (3,)))
    for x, y in zip(found, function(key, X), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-6)


def test_what_draws_nothing_is_handed_nothing():
    pure, noise = split(lambda key, x: x + 1.0)
    assert noise == []
    np.testing.assert_array_equal(pure(X)[0], X + 1.0)


@pytest.mark.parametrize(
    "draw",
    [
        lambda key, x: x + jax.random.uniform(key, (3,), maxval=0.5),
        lambda key, x: x + jax.random.exponential(key, (3,)),
        lambda key, x: x + jax.random.bits(key, (3,)),
        lambda key, x: jax.random.permutation(key, x),
    ],
    ids=["another range", "exponential", "bits", "permutation"],
)
def test_what_is_no_standard_noise_is_refused(draw):
    with pytest.raises(UsageError, match="draws by its key what is no standard normal, uniform or"):
        split(draw)
