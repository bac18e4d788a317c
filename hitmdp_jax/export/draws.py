"""A traced function of a PRNG key as one of the noise that it draws."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.extend import core
from jax.interpreters.partial_eval import dce_jaxpr

from hitmdp_jax.errors import UsageError

# What `jax.random`'s functions are called in a traced function -> what they draw.
DISTRIBUTIONS = {"_normal": "normal", "_uniform": "uniform", "_gumbel": "gumbel"}


class Noise(NamedTuple):
    """What a function draws at one place: independent standard numbers."""

    distribution: str  # "normal"; "uniform", from 0 to 1; or "gumbel"
    shape: jax.ShapeDtypeStruct  # without the axes of length one in front, which Distrax adds
    axes: tuple[int, ...]  # these


def without_key(traced: core.ClosedJaxpr) -> tuple[Callable[..., list[jax.Array]], list[Noise]]:
    """Return a function that is handed the noise that it would draw.

    Args:
      traced: a function of a key and of arrays, as `jax.make_jaxpr` gives it.

    Returns:
      The function of the arrays, and of the noise; and what that noise is, in order. It draws the
      same as before where it is given what `jax.random` draws by the keys split off.

    Raises:
      UsageError: the key is needed for something else than standard noise.
    """
    jaxpr, size = traced.jaxpr, len(traced.jaxpr.invars) - 1
    draws = [equation for equation in jaxpr.eqns if _distribution(equation)]
    others = [equation for equation in jaxpr.eqns if not _distribution(equation)]
    drawn = [variable for equation in draws for variable in equation.outvars]
    handed_over = jaxpr.replace(invars=[*jaxpr.invars, *drawn], eqns=others)
    # With the key goes what nothing follows from: what split it.
    keep = [False] + [True] * (size + len(drawn))
    pruned, used = dce_jaxpr(handed_over, [True] * len(jaxpr.outvars), keep)
    if used[0]:
        raise UsageError(
            "The policy draws by its key what is no standard normal, uniform or Gumbel noise: only "
            "the deterministic one can be exported."
        )
    noise = [_noise(equation) for equation in draws]
    run = core.jaxpr_as_fun(core.ClosedJaxpr(pruned, traced.consts))

    def function(*arrays: jax.Array) -> list[jax.Array]:
        pairs = zip(arrays[size:], noise, strict=True)
        return run(*arrays[:size], *(jnp.expand_dims(x, each.axes) for x, each in pairs))

    return function, noise


def _noise(equation: Any) -> Noise:
    (variable,) = equation.outvars
    shape, dtype = variable.aval.shape, variable.aval.dtype
    ones = next((i for i, length in enumerate(shape) if length != 1), len(shape))
    own = jax.ShapeDtypeStruct(shape[ones:], dtype)
    return Noise(str(_distribution(equation)), own, tuple(range(ones)))


def _distribution(equation: Any) -> str | None:
    """Return what an equation draws from; None if it draws nothing, or not standard noise."""
    if equation.primitive.name != "jit":
        return None
    name = DISTRIBUTIONS.get(equation.params["name"])
    bounds = [x.val for x in equation.invars[1:] if isinstance(x, core.Literal)]
    return None if name == "uniform" and bounds != [0.0, 1.0] else name
