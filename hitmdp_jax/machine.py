"""What this process may use of its machine."""

import os


def available_cores() -> int:
    """Return how many cores this process may run on: fewer than there are under `taskset`."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
