"""The two axes along which work is spread over devices, as the pure programs see them.

`trial` counts independent trainings, between which nothing passes. `data` shares out the
environments of one training: each device steps its own, and XLA partitions what is computed from
them, sums and means over all environments included. Outside of a mesh with a `data` axis that XLA
partitions (`jax.sharding.AxisType.Auto`), what is here does nothing.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jax.sharding import AxisType
from jax.sharding import PartitionSpec as P

TRIAL, DATA = "trial", "data"


def each_device(function: Callable[..., Any], *batches: Any) -> Any:
    """Return `function(*batches)` of arrays [B, ...], each device computing its own rows.

    Physics is computed so, and not left to XLA's partitioner: of a call to MuJoCo C it would gather
    the rows of all devices, and a solver's loop would ask all devices whether to go on. Where the
    devices do not divide B, each computes all.

    Args:
      function: maps arrays [N, ...] to arrays [N, ...], row by row, for any N.
      *batches: pytrees of arrays [B, ...].
    """
    devices = _data_devices()
    if devices == 1 or len(jax.tree.leaves(batches)[0]) % devices:
        return function(*batches)
    by_device = jax.shard_map(
        function, in_specs=P(DATA), out_specs=P(DATA), axis_names={DATA}, check_vma=False
    )
    return by_device(*batches)


def in_chunks(function: Callable[[Any], Any], batch: Any, size: int) -> Any:
    """Return `jax.vmap(function)(batch)`, computed so many rows at once.

    `jax.lax.map` does the same with its `batch_size`, but fails on arrays without entries, which
    the states of simulators contain.

    Args:
      function: maps one row.
      batch: a pytree of arrays [N, ...], N > 0.
      size: rows at once; the rest comes last.
    """
    rows = len(jax.tree.leaves(batch)[0])
    size = min(size, rows)
    whole = rows // size
    each, even = jax.vmap(function), whole * size
    chunks = jax.tree.map(lambda x: x[:even].reshape(whole, size, *x.shape[1:]), batch)
    mapped = jax.lax.map(each, chunks)
    mapped = jax.tree.map(lambda x: x.reshape(even, *x.shape[2:]), mapped)
    if even == rows:
        return mapped
    rest = each(jax.tree.map(lambda x: x[even:], batch))
    return jax.tree.map(lambda x, y: jnp.concatenate([x, y]), mapped, rest)


def over_data(tree: Any, axis: int) -> Any:
    """Lay an axis of arrays out over the devices of `data`, where they divide it."""
    devices = _data_devices()

    def spread(x: jax.Array) -> jax.Array:
        if devices == 1 or x.shape[axis] % devices:
            return x
        return jax.lax.with_sharding_constraint(x, P(*[None] * axis, DATA))

    return jax.tree.map(spread, tree)


def on_every_device(tree: Any) -> Any:
    """Bring arrays whole to every device of `data`."""
    return jax.lax.with_sharding_constraint(tree, P()) if _data_devices() > 1 else tree


def _data_devices() -> int:
    """Return over how many devices the program being traced spreads its environments."""
    mesh = jax.sharding.get_abstract_mesh()
    axes = dict(zip(mesh.axis_names, mesh.axis_types, strict=True))
    return mesh.shape[DATA] if axes.get(DATA) == AxisType.Auto else 1


@custom_vmap
def for_all(due: jax.Array) -> jax.Array:
    """Return a bool that all trainings of a program share: a `cond` on it stays one under `vmap`.

    The trainings of a program count their iterations alike, so what is due is due for all.
    """
    return due


@for_all.def_vmap
def _for_all_mapped(size: int, mapped: list[bool], due: jax.Array) -> tuple[jax.Array, bool]:
    del size, mapped
    return for_all(due.any()), False
