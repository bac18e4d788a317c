"""All that the package computes has 32 bits, whatever JAX's default is."""

from typing import Any

import jax
import jax.numpy as jnp

NARROW = {
    "float64": jnp.float32,
    "complex128": jnp.complex64,
    "int64": jnp.int32,
    "uint64": jnp.uint32,
}


def in_32_bits(tree: Any) -> Any:
    """Return a tree with its arrays of 64 bits in 32; all else is as it was.

    Under `jax_enable_x64` an array has 64 bits wherever no type is named: in a task of one's own,
    in Brax and in Distrax.
    """
    return jax.tree.map(_narrow, tree)


def as_before(after: Any, before: Any) -> Any:
    """Return a state of a task in the types of the one before, where only their bits differ.

    A task computes in the types it likes, and its own state is left to it; but what a loop carries
    must keep its types, which not all of Brax's tasks see to under `jax_enable_x64`.
    """

    def same(x: Any, like: Any) -> Any:
        differ = getattr(x, "dtype", None) != getattr(like, "dtype", None)
        alike = differ and jnp.result_type(_narrow(x)) == jnp.result_type(_narrow(like))
        return jnp.asarray(x, like.dtype) if alike else x

    return jax.tree.map(same, after, before)


def _narrow(x: Any) -> Any:
    to = NARROW.get(str(getattr(x, "dtype", "")))
    return x if to is None else jnp.asarray(x, to)
