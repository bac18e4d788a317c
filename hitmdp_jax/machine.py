"""What a process runs on: cores, the device, the packages' versions."""

import importlib.metadata
import os
import platform
from pathlib import Path

import jax

PACKAGES = ("hitmdp-jax", "jax", "jaxlib", "flax", "optax", "brax", "mujoco", "mujoco-mjx", "numpy")
CPU_INFO = Path("/proc/cpuinfo")  # on Linux


def available_cores() -> int:
    """Return how many cores this process may run on: fewer than there are under `taskset`."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def versions() -> list[str]:
    """Return the names and versions of this package and of those it needs, and the device."""
    found = [f"{name} {importlib.metadata.version(name)}" for name in PACKAGES]
    device = jax.devices()[0]
    kind = processor() if device.platform == "cpu" else device.device_kind
    return [*found, f"Python {platform.python_version()}", f"{device.platform} ({kind})"]


def processor() -> str:
    """Return the name of the machine's processor."""
    lines = CPU_INFO.read_text().splitlines() if CPU_INFO.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
