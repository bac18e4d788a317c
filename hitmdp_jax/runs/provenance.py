"""What trained a run, part by part: noted in its folder, and read on whatever machine."""

from pathlib import Path

from hitmdp_jax import machine
from hitmdp_jax.errors import printable
from hitmdp_jax.runs.folder import MADE_WITH, write


def note_versions(run_dir: Path) -> None:
    """Note what trains a run from here on, in its folder."""
    before, now = _lines(run_dir), ", ".join(machine.versions())
    if before[-1:] != [now]:
        write(run_dir / MADE_WITH, "\n".join([*before, now]) + "\n")


def made_with(run_dir: Path) -> str:
    """Return the versions and the machine that trained a run."""
    return "; then ".join(_lines(run_dir)) or "unknown versions"


def _lines(run_dir: Path) -> list[str]:
    path = run_dir / MADE_WITH
    # A damaged file is no reason not to train on.
    text = path.read_text("utf-8", "replace") if path.is_file() else ""
    return list(map(printable, text.splitlines()))
