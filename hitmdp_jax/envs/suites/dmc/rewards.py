"""`tolerance`: how well a quantity meets its goal, from 0 to 1, as DeepMind Control measures it."""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp

from hitmdp_jax.errors import out_of_domain, unknown_name


def _gaussian(d: jax.Array, v: float) -> jax.Array:
    return jnp.exp(math.log(v) * d**2)


def _linear(d: jax.Array, v: float) -> jax.Array:
    x = (1 - v) * d
    return jnp.where(x < 1, 1 - x, 0.0)


def _quadratic(d: jax.Array, v: float) -> jax.Array:
    x = math.sqrt(1 - v) * d
    return jnp.where(x < 1, 1 - x**2, 0.0)


# name -> f(d, v) with f(0, v) = 1 and f(1, v) = v, for a distance d in margins: those that tasks
# need of DeepMind Control's. The linear and the quadratic one reach 0, and allow it at the margin.
_SIGMOIDS: dict[str, Callable[[jax.Array, float], jax.Array]] = {
    "gaussian": _gaussian,
    "linear": _linear,
    "quadratic": _quadratic,
}


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
      sigmoid: gaussian, linear or quadratic.
      value_at_margin: in (0, 1); linear and quadratic allow 0.

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
    if not 0 <= value_at_margin < 1 or (value_at_margin == 0 and sigmoid == "gaussian"):
        wanted = "between 0 and 1" if sigmoid == "gaussian" else "from 0 to 1 without 1"
        raise out_of_domain("value_at_margin", value_at_margin, wanted)
    distance = jnp.maximum(jnp.maximum(lower - x, x - upper), 0.0)
    return _SIGMOIDS[sigmoid](distance / margin, value_at_margin)
