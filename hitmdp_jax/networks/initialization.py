"""Another start for a network's layers than the orthogonal one: PyTorch's."""

import math
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp

INITIALIZATIONS = ("orthogonal", "pytorch")
IN_PROJECTIONS = ("query", "key", "value")  # of an attention, which PyTorch keeps in one matrix


def pytorch_start(params: Mapping[str, Any], key: jax.Array) -> dict[str, Any]:
    """Return parameters whose layers start as PyTorch's `Linear` and `MultiheadAttention` do.

    A layer of n inputs draws its weights and its bias from U(-1/sqrt(n), 1/sqrt(n)). The kernels
    `input_0`, `input_1`, ... of one layer (`mlp.MLP`) count together. An attention of width E draws
    the projections of queries, keys and values from U(-sqrt(6/(4E)), sqrt(6/(4E))), the projection
    of its results as a layer does, and its biases are 0. What is no layer stays as it is.

    Args:
      params: of a Flax network.
      key: of the draws.
    """
    keys = dict(zip(sorted(params), jax.random.split(key, len(params)), strict=True))
    inputs = sum(len(part["kernel"]) for name, part in params.items() if name.startswith("input_"))
    drawn: dict[str, Any] = {}
    for name, part in params.items():
        if not isinstance(part, Mapping):
            drawn[name] = part
        elif "kernel" in part:
            bound = (inputs if name.startswith("input_") else len(part["kernel"])) ** -0.5
            drawn[name] = _uniform(part, dict.fromkeys(part, bound), keys[name])
        elif "query_kernel" in part:
            width = len(part["query_kernel"])
            bounds = {f"{each}_kernel": math.sqrt(6 / (4 * width)) for each in IN_PROJECTIONS}
            bounds["out_kernel"] = width**-0.5
            zero = {each: jnp.zeros_like(x) for each, x in part.items() if each.endswith("_bias")}
            drawn[name] = _uniform(part, bounds, keys[name]) | zero
        else:
            drawn[name] = pytorch_start(part, keys[name])
    return drawn


def _uniform(part: Mapping[str, Any], bounds: dict[str, float], key: jax.Array) -> dict[str, Any]:
    """Return arrays of the shapes of `part` from U(-bound, bound) of each name."""
    keys = zip(sorted(bounds), jax.random.split(key, len(bounds)), strict=True)
    return {
        name: jax.random.uniform(one, part[name].shape, jnp.float32, -bounds[name], bounds[name])
        for name, one in keys
    }
