"""What numbers may be, checked where settings and hyperparameters are."""

import math
import os
from typing import Any

import numpy as np

from hitmdp_jax.errors import UsageError

MACHINES = 16  # as much memory as this machine's accelerators may have beside its own
MOST = 2**31 - 1  # whole numbers that shape a program are int32


def is_positive_whole(x: Any) -> bool:
    """Return whether a value is a whole number from 1."""
    return isinstance(x, int) and not isinstance(x, bool) and x > 0


def in_float32(x: Any) -> float:
    """Return a number as programs compute with it: 1e39 is infinite there, and 1e-50 is 0."""
    with np.errstate(over="ignore", under="ignore"):
        return float(np.float32(max(-1e300, min(1e300, x)))) if math.isfinite(x) else float(x)


def memory() -> int:
    """Return the bytes of memory that this machine has, without its accelerators."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def check_memory(parts: dict[str, int]) -> None:
    """Reject what cannot fit into memory, before anything of it is made.

    Accelerators and further processes, of which nothing is known yet, bring memory of their own.

    Args:
      parts: the settings that make a part of what is needed -> its bytes, at the least.

    Raises:
      UsageError: the parts are more than what is available; names the largest.
    """
    needed = sum(parts.values())
    if needed > MACHINES * memory():
        largest = max(parts, key=lambda name: parts[name])
        raise UsageError(
            f"That takes at least {_told(needed)} of memory, most of it for {largest}, and this "
            f"machine has {_told(memory())}: lower them."
        )


def _told(size: float) -> str:
    for unit in ("bytes", "KiB", "MiB", "GiB"):
        if size < 1024:
            return f"{size:,.1f} {unit}"
        size /= 1024
    return f"{size:,.1f} TiB" if size < 1e6 else f"{size:.1e} TiB"
