"""A replay of transitions: what off-policy agents learn from long after it happened.

A ring on the device, written in place where its buffer is donated. Brax's queues move all that they
hold at every insertion once they are full, which under `vmap` they do in any case.
"""

from typing import Any

import jax
import jax.numpy as jnp
from flax import struct


class Replay(struct.PyTreeNode):
    """The newest transitions, at most C of them."""

    data: Any  # [C, ...]
    place: jax.Array  # int32, where the next one is written
    size: jax.Array  # int32, how many there are


def empty(example: Any, capacity: int) -> Replay:
    """Return a replay of nothing.

    Args:
      example: a pytree of one transition's arrays, or of their shapes and types.
      capacity: C.
    """
    data = jax.tree.map(lambda x: jnp.zeros((capacity, *x.shape), x.dtype), example)
    return Replay(data, jnp.zeros((), jnp.int32), jnp.zeros((), jnp.int32))


def add(replay: Replay, transitions: Any) -> Replay:
    """Return the replay with transitions [N, ...] in place of the oldest, where it is full."""
    capacity, number = (len(jax.tree.leaves(x)[0]) for x in (replay.data, transitions))
    kept = min(number, capacity)  # two writes to one place would have no order
    places = (replay.place + jnp.arange(number - kept, number, dtype=jnp.int32)) % capacity
    data = jax.tree.map(
        lambda old, new: old.at[places].set(new[number - kept :]), replay.data, transitions
    )
    place = (replay.place + number) % capacity
    return Replay(data, place, jnp.minimum(replay.size + number, capacity))


def sample(replay: Replay, key: jax.Array, number: int) -> Any:
    """Return transitions [number, ...] drawn uniformly, with replacement; it must hold some."""
    places = jax.random.randint(key, (number,), 0, replay.size, jnp.int32)
    return jax.tree.map(lambda x: x[places], replay.data)
