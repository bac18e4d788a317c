"""What functions make of shapes, found out by tracing them: nothing is compiled or computed."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def traced(function: Callable[..., Any], *args: Any) -> Any:
    """Return a function's result, uncomputed: `jax.ShapeDtypeStruct` in place of arrays.

    What the function raises is raised as it is. `args` are arrays, or shapes and types of arrays.
    """
    found: list[Any] = []

    def call(*args: Any) -> tuple[()]:
        found.append(jax.tree.map(_shape_of, function(*args)))
        return ()

    jax.eval_shape(call, *args)
    return found[0]


def _shape_of(x: Any) -> Any:
    if hasattr(x, "shape") and hasattr(x, "dtype"):
        return jax.ShapeDtypeStruct(x.shape, x.dtype)
    if isinstance(x, bool | int | float | complex | np.generic):
        return jax.ShapeDtypeStruct((), jnp.result_type(x))
    return x


def is_array(x: Any) -> bool:
    """Return whether `traced` found an array there."""
    return isinstance(x, jax.ShapeDtypeStruct)


def shown(x: Any) -> str:
    """Return how a sentence shows what `traced` found: `float32[3]`, or a type."""
    return f"{x.dtype}{list(x.shape)}" if is_array(x) else f"a {type(x).__name__}"


def difference(before: Any, after: Any, this: str, that: str) -> str | None:
    """Return the first difference between two trees of `traced` in words, or None.

    Args:
      before: a tree.
      after: what should be of the same structure, shapes and types.
      this: what made `before`, for the sentence.
      that: what made `after`.
    """
    first, second = (
        {jax.tree_util.keystr(path): x for path, x in jax.tree_util.tree_leaves_with_path(tree)}
        for tree in (before, after)
    )
    for path in [*first, *second]:
        if path not in second:
            return f"{this} makes {_name(path)}, which {that} does not"
        if path not in first:
            return f"{that} makes {_name(path)}, which {this} does not"
        if not is_array(first[path]) or first[path] != second[path]:
            one, other = shown(first[path]), shown(second[path])
            return f"{_name(path)} is {one} of {this} and {other} of {that}"
    if jax.tree.structure(before) != jax.tree.structure(after):
        return f"{this} and {that} make different structures"
    return None


def _name(path: str) -> str:
    return path.lstrip(".") or "what it returns"
