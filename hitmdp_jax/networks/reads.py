"""Which parts of an observation each network of an agent reads."""

from typing import NamedTuple

import jax
import numpy as np

Entries = tuple[int, ...] | None  # of an observation's row, in its order; None: all


class Reads(NamedTuple):
    """What each network reads of an observation's row; static."""

    action: Entries = None
    master: Entries = None
    critic: Entries = None
    posterior: Entries = None


def read(obs: jax.Array, entries: Entries) -> jax.Array:
    """Return the entries [..., R] of observations [..., O] that a network reads."""
    return obs if entries is None else obs[..., np.array(entries)]
