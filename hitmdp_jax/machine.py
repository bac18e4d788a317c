"""What a process runs on, and a run was made with: cores, the device, the packages' versions."""

import importlib.metadata
import os
import platform
from pathlib import Path

import jax

from hitmdp_jax.errors import printable
from hitmdp_jax.training.folder import MADE_WITH, write

PACKAGES = ("hitmdp-jax", "jax", "jaxlib", "flax", "optax", "brax", "mujoco", "mujoco-mjx", "numpy")
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
    before, now = _lines(run_dir), ", ".join(versions())
    if before[-1:] != [now]:
        write(run_dir / MADE_WITH, "\n".join([*before, now]) + "\n")


def made_with(run_dir: Path) -> str:
    """Return what trained a run, on whatever machine it is asked for."""
    return "; then ".join(_lines(run_dir)) or "unknown versions"


def _lines(run_dir: Path) -> list[str]:
    path = run_dir / MADE_WITH
    # A damaged file is no reason not to train on.
    text = path.read_text("utf-8", "replace") if path.is_file() else ""
    return list(map(printable, text.splitlines()))


def processor() -> str:
    """Return what the machine's processor is called."""
    lines = CPU_INFO.read_text().splitlines() if CPU_INFO.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
