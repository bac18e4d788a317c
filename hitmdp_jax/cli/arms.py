"""A training in a process of its own, which can be stopped and gone on with."""

import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from hitmdp_jax.cli.overrides import quoted
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments.experiment import last_of_each
from hitmdp_jax.runs.claim import already_there
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import made
from hitmdp_jax.runs.interrupt import SIGNALS


def configs_of(cells: Mapping[str, Sequence[str]], trust: bool = True) -> dict[str, RunConfig]:
    """Return each cell's validated settings.

    Args:
      cells: name -> settings of train.py.
      trust: run the files that they name: a command line does, and not a file of somebody's.

    Raises:
      UsageError: as `Settings` and `RunConfig.from_mapping`.
    """
    return {cell: Settings(settings).config(trust=trust) for cell, settings in cells.items()}


def train_into(run_dir: Path, settings: Sequence[str], trust: bool = True) -> int:
    """Train, or go on with what the folder holds; a finished run is left as it is.

    Args:
      run_dir: the run's folder.
      settings: of train.py.
      trust: as `configs_of`.

    Returns:
      0, or the exit code that a signal led to.

    Raises:
      UsageError: a setting is wrong, the folder holds another run, or the run failed.
    """
    known = already_there(run_dir, Settings(settings).config(trust=trust))
    made(run_dir.parent)
    name = quoted(str(run_dir))
    where = [f"resume={name}", "trust=true"] if known else [*settings, f"run_dir={name}"]
    # Of a run that is finished it says so. What it is trained for reports on all of them.
    code = train(last_of_each([*where, "report=false"]))
    if code > 128:
        print(f"Stopped in {run_dir}. The same command continues from there.")
        return code
    if code not in (0, 3):  # 3: a seed diverged, and said so
        raise UsageError(f"The run in {run_dir} failed; it stopped there.")
    return 0


def train(settings: Sequence[str]) -> int:
    """Run a training in a process of its own and wait for it; return its exit code.

    A signal is handed on: the training saves what it has, and then both end.
    """
    command = [sys.executable, "-m", "hitmdp_jax", "train", *settings]
    # A session of its own: a terminal's Ctrl-C would reach it twice, and twice means at once.
    process = subprocess.Popen(command, start_new_session=True)
    previous = {s: signal.signal(s, lambda signum, _: process.send_signal(signum)) for s in SIGNALS}
    try:
        code = process.wait()
    finally:
        for signum, handler in previous.items():
            signal.signal(signum, handler)
    return 128 - code if code < 0 else code


def named(arguments: Sequence[str]) -> dict[str, str]:
    """Return the settings `name=value` among arguments by name.

    Raises:
      UsageError: one is given twice.
    """
    found: dict[str, str] = {}
    for text in arguments:
        name, is_setting, value = text.partition("=")
        if name in found:
            raise UsageError(f"'{name}={found[name]}' and '{text}' set {name} twice.")
        if is_setting:
            found[name] = value
    return found
