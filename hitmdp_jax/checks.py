"""What numbers may be, checked where settings and hyperparameters are."""

import math
import os
from typing import Any

import numpy as np

from hitmdp_jax.errors import UsageError, out_of_domain

MACHINES = 16  # as much memory as accelerators may have that are not known yet
MOST = 2**31 - 1  # whole numbers that shape a program are int32
MOST_ASKED = 10**12  # more than any other whole number that is asked for


def is_positive_whole(x: Any) -> bool:
    """Return whether a value is a whole number from 1."""
    return isinstance(x, int) and not isinstance(x, bool) and x > 0


def fault_of_whole(values: tuple[Any, ...], wanted: str, most: float = MOST) -> str:
    """Return which values positive whole numbers may have, or nothing if they are valid."""
    if not all(map(is_positive_whole, values)):
        return wanted
    return f"{wanted}, at most {most:,}" if max(values) > most else ""


def check_size(name: str, size: Any, most: float = math.inf) -> None:
    """Raise UsageError where a size is not a positive whole number, or more than `most`."""
    if wanted := fault_of_whole((size,), "a positive whole number", most):
        raise out_of_domain(name, size, wanted)


def whole_number(name: str, value: Any, at_least: int) -> int:
    """Return a whole number, which may be written as 1e6.

    Raises:
      UsageError: it is none, or less than `at_least`, or more than anyone asks for.
    """
    wanted = "a positive whole number" if at_least else "a whole number from 0"
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not math.isfinite(value) or value != int(value) or value < at_least:
        raise out_of_domain(name, value, wanted)
    if value > MOST_ASKED:
        raise out_of_domain(name, value, f"{wanted}, at most {MOST_ASKED:.0e}")
    return int(value)


def true_or_false(name: str, value: Any) -> bool:
    """Return a setting that is either.

    Raises:
      UsageError: it is neither.
    """
    if not isinstance(value, bool):
        raise out_of_domain(name, value, "true or false")
    return value


def divisor_below(number: int, most: int) -> int:
    """Return the largest divisor of a number that is not above `most`."""
    small = (d for d in range(1, min(most, math.isqrt(number)) + 1) if number % d == 0)
    return max(x for d in small for x in (d, number // d) if x <= most)


def in_float32(x: Any) -> float:
    """Return a number as programs compute with it: 1e39 is infinite there, and 1e-50 is 0."""
    with np.errstate(over="ignore", under="ignore"):
        return float(np.float32(max(-1e300, min(1e300, x)))) if math.isfinite(x) else float(x)


def memory() -> int:
    """Return the bytes of memory that this machine has, without its accelerators."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def check_memory(parts: dict[str, int], available: int | None = None) -> None:
    """Reject what cannot fit into memory, before anything of it is made.

    Args:
      parts: the settings that make a part of what is needed -> its bytes, at the least.
      available: bytes; None takes what this machine has, and `MACHINES` times as much where
        accelerators and further processes, of which nothing is known yet, may bring their own.

    Raises:
      UsageError: the parts are more than what is available; names the largest.
    """
    needed, has = sum(parts.values()), memory() if available is None else available
    if needed > (has if available is not None else MACHINES * has):
        largest = max(parts, key=lambda name: parts[name])
        raise UsageError(
            f"That takes at least {_told(needed)} of memory, most of it for {largest}, and this "
            f"machine has {_told(has)}: lower these numbers."
        )


def _told(size: float) -> str:
    for unit in ("bytes", "KiB", "MiB", "GiB"):
        if size < 1024:
            return f"{size:,.1f} {unit}"
        size /= 1024
    return f"{size:,.1f} TiB" if size < 1e6 else f"{size:.1e} TiB"
