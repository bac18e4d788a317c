"""What a process runs on, and a run was made with: cores, the device, the packages' versions."""

import importlib.metadata
import os
import platform
from pathlib import Path

import jax

PACKAGES = ("hitmdp-jax", "jax", "jaxlib", "flax", "optax", "brax", "mujoco", "mujoco-mjx", "numpy")
MADE_WITH = "made_with.txt"  # in a run's folder: a line for whatever trained a part of it
CPU_INFO = Path("/proc/cpuinfo")  # on Linux


def available_cores() -> int:
    """Return how many cores this process may run on: fewer than there are under `taskset`."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def versions() -> list[str]:
    """Return what the package and those it stands on are called and numbered, and the device."""
    found = [f"{name} {importlib.metadata.version(name)}" for name in PACKAGES]
    device = jax.devices()[0]
    kind = processor() if device.platform == "cpu" else device.device_kind
    return [*found, f"Python {platform.python_version()}", f"{device.platform} ({kind})"]


def note_versions(run_dir: Path) -> None:
    """Note what trains a run from here on, in its folder."""
    path, now = run_dir / MADE_WITH, ", ".join(versions())
    before = path.read_text().splitlines() if path.is_file() else []
    if before[-1:] != [now]:
        path.write_text("\n".join([*before, now]) + "\n")


def made_with(run_dir: Path) -> str:
    """Return what trained a run, on whatever machine it is asked for."""
    path = run_dir / MADE_WITH
    return "; then ".join(path.read_text().splitlines()) if path.is_file() else "unknown versions"


def processor() -> str:
    """Return what the machine's processor is called."""
    lines = CPU_INFO.read_text().splitlines() if CPU_INFO.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
