import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dm_control.utils import rewards
from hypothesis import given, settings
from hypothesis import strategies as st

from hitmdp_jax.envs.suites.dmc.rewards import tolerance
from hitmdp_jax.errors import UsageError

SIGMOIDS = ("gaussian", "linear", "quadratic")


def single(low, high):
    return st.floats(low, high, width=32)


@given(
    x=st.lists(single(-20, 20), min_size=4, max_size=4),  # one shape, as each is compiled anew
    lower=single(-8, 8) | st.just(-math.inf),
    width=single(0, 4) | st.just(math.inf),
    margin=st.just(0.0) | single(0.125, 8),
    sigmoid=st.sampled_from(SIGMOIDS),
    value=single(0.0078125, 0.984375) | st.just(0.0),
)
@settings(max_examples=300)
def test_agrees_with_dm_control(x, lower, width, margin, sigmoid, value):
    if value == 0 and sigmoid == "gaussian":
        value = 0.1
    upper = width if lower == -math.inf else lower + width
    x = np.float32(x)
    with np.errstate(all="ignore"):
        # Where the value jumps, rounding decides: stay off the bounds, but on them exactly.
        x = np.where(np.abs(x - lower) < 1e-3, np.float32(lower), x)
        x = np.where(np.abs(x - upper) < 1e-3, np.float32(upper), x)
        lower, upper = float(np.float32(lower)), float(np.float32(upper))
        arguments = ((lower, upper), margin, sigmoid, value)
        desired = rewards.tolerance(np.float64(x), *arguments)
    np.testing.assert_allclose(tolerance(jnp.asarray(x), *arguments), desired, atol=2e-5)


@pytest.mark.parametrize("sigmoid", SIGMOIDS)
@pytest.mark.parametrize("bounds", [(1.0, 1.0), (1.0, math.inf), (-math.inf, 1.0)])
def test_gradient_is_finite_inside_and_outside(sigmoid, bounds):
    def value(x):
        return tolerance(x, bounds, margin=2.0, sigmoid=sigmoid, value_at_margin=0.5)

    gradients = jax.jit(jax.vmap(jax.grad(value)))(jnp.array([-30.0, 0.0, 0.9, 1.1, 2.0, 30.0]))
    assert jnp.isfinite(gradients).all()
    assert jnp.abs(gradients).max() > 0.01


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"bounds": (1.0, 0.0)}, "bounds"),
        ({"margin": -1.0}, "margin"),
        ({"margin": 1.0, "sigmoid": "gausian"}, "did you mean 'gaussian'?"),
        ({"margin": 1.0, "value_at_margin": 0.0}, "value_at_margin"),
        ({"margin": 1.0, "sigmoid": "linear", "value_at_margin": 1.0}, "value_at_margin"),
    ],
)
def test_mistakes_are_explained(arguments, sentence):
    with pytest.raises(UsageError, match=sentence.replace("?", r"\?")):
        tolerance(jnp.zeros(()), **arguments)
