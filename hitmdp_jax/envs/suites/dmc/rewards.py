"""`tolerance`: how well a quantity meets its goal, from 0 to 1, as DeepMind Control measures it."""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp

from hitmdp_jax.errors import out_of_domain, unknown_name


def _vanish_beyond_one(value: jax.Array, x: jax.Array) -> jax.Array:
    return jnp.where(x < 1, value, 0.0)


def _gaussian(d: jax.Array, v: float) -> jax.Array:
    return jnp.exp(math.log(v) * d**2)


def _hyperbolic(d: jax.Array, v: float) -> jax.Array:
    return 1 / jnp.cosh(math.acosh(1 / v) * d)


def _long_tail(d: jax.Array, v: float) -> jax.Array:
    return 1 / (1 + (1 / v - 1) * d**2)


def _reciprocal(d: jax.Array, v: float) -> jax.Array:
    return 1 / (1 + (1 / v - 1) * d)


def _tanh_squared(d: jax.Array, v: float) -> jax.Array:
    return 1 - jnp.tanh(math.atanh(math.sqrt(1 - v)) * d) ** 2


def _cosine(d: jax.Array, v: float) -> jax.Array:
    x = math.acos(2 * v - 1) / math.pi * d
    return _vanish_beyond_one((1 + jnp.cos(math.pi * jnp.minimum(x, 1.0))) / 2, x)


def _linear(d: jax.Array, v: float) -> jax.Array:
    x = (1 - v) * d
    return _vanish_beyond_one(1 - x, x)


def _quadratic(d: jax.Array, v: float) -> jax.Array:
    x = math.sqrt(1 - v) * d
    return _vanish_beyond_one(1 - x**2, x)


# name -> f(d, v) with f(0, v) = 1 and f(1, v) = v, for a distance d in margins.
_SIGMOIDS: dict[str, Callable[[jax.Array, float], jax.Array]] = {
    "gaussian": _gaussian,
    "hyperbolic": _hyperbolic,
    "long_tail": _long_tail,
    "reciprocal": _reciprocal,
    "tanh_squared": _tanh_squared,
    "cosine": _cosine,
    "linear": _linear,
    "quadratic": _quadratic,
}
_REACH_ZERO = ("cosine", "linear", "quadratic")  # these allow a value of 0 at the margin


def tolerance(
    x: jax.Array,
    bounds: tuple[float, float] = (0.0, 0.0),
    margin: float = 0.0,
    sigmoid: str = "gaussian",
    value_at_margin: float = 0.1,
) -> jax.Array:
    """Return 1 where `x` lies inside `bounds` and less, down to 0, the further it lies outside.

    With d the distance from x to the nearest bound, divided by `margin`, the value is f(d) for the
    named f, which falls from f(0) = 1 through f(1) = `value_at_margin`: the Gaussian is
    value_at_margin^(d²). A margin of 0 makes it the indicator of the bounds.

    Args:
      x: any shape; the only argument that may be traced.
      bounds: lower and upper, both inside; infinite where there is none.
      margin: in the units of x.
      sigmoid: gaussian, hyperbolic, long_tail, reciprocal, tanh_squared, cosine, linear or
        quadratic.
      value_at_margin: in (0, 1); cosine, linear and quadratic allow 0.

    Raises:
      UsageError: an argument is outside its domain.

    >>> float(tolerance(jnp.float32(5.0), bounds=(10.0, math.inf), margin=10.0, sigmoid="linear",
    ...                 value_at_margin=0.0))
    0.5
    """
    lower, upper = bounds
    if lower > upper:
        raise out_of_domain("bounds", bounds, "a lower and an upper bound, in this order")
    if margin < 0:
        raise out_of_domain("margin", margin, "a number from 0")
    if margin == 0:
        return jnp.where((lower <= x) & (x <= upper), 1.0, 0.0)
    if sigmoid not in _SIGMOIDS:
        raise unknown_name("sigmoid", sigmoid, _SIGMOIDS)
    if not 0 <= value_at_margin < 1 or (value_at_margin == 0 and sigmoid not in _REACH_ZERO):
        wanted = "from 0 to 1 without 1" if sigmoid in _REACH_ZERO else "between 0 and 1"
        raise out_of_domain("value_at_margin", value_at_margin, wanted)
    distance = jnp.maximum(jnp.maximum(lower - x, x - upper), 0.0)
    return _SIGMOIDS[sigmoid](distance / margin, value_at_margin)
