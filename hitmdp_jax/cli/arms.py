"""Several trainings one after the other, each in a process of its own, that can be gone on with."""

import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from hitmdp_jax.cli.settings import Settings, quoted
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.claim import already_there
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import made
from hitmdp_jax.runs.interrupt import SIGNALS


def configs_of(arms: Mapping[str, Sequence[str]], trust: bool = True) -> dict[str, RunConfig]:
    """Return each arm's validated settings; args as `train_arms`.

    Raises:
      UsageError: as `Settings` and `RunConfig.from_mapping`.
    """
    return {arm: Settings(settings).config(trust=trust) for arm, settings in arms.items()}


def train_arms(arms: Mapping[str, Sequence[str]], folder: Path, trust: bool = True) -> int:
    """Train every arm into `folder/<arm>`, or go on with it; a finished run is left as it is.

    Args:
      arms: name -> settings of train.py.
      folder: of all.
      trust: run the files that the arms name: a command line does, and not a file of somebody's.

    Returns:
      0, or the exit code that a signal led to.

    Raises:
      UsageError: a setting is wrong, a folder holds another run, or a run failed.
    """
    for arm in arms:
        if not is_folder_name(arm):
            raise UsageError(f"An arm named {arm!r} cannot be a folder's name: no / and no dots.")
    configs = configs_of(arms, trust)
    run_dirs = {arm: folder / arm for arm in arms}
    known = {arm: already_there(run_dirs[arm], configs[arm]) for arm in arms}
    made(folder)
    for arm, run_dir in run_dirs.items():
        name = quoted(str(run_dir))
        where = [f"resume={name}", "trust=true"] if known[arm] else [*arms[arm], f"run_dir={name}"]
        # Of a run that is finished it says so. What arms are trained for reports on all of them.
        code = train(last_of_each([*where, "report=false"]))
        if code > 128:
            print(f"Stopped in {arm}. The same command with run_dir={folder} goes on from there.")
            return code
        if code not in (0, 3):  # 3: a seed diverged, and said so
            raise UsageError(f"The run of {arm} failed; it stopped there.")
    return 0


def is_folder_name(name: str) -> bool:
    """Return whether a name is that of a folder inside another one, and of nothing else."""
    return name.isprintable() and name == Path(name).name and name not in ("", "..")


def last_of_each(settings: Sequence[str]) -> list[str]:
    """Return settings without those that a later one of the same name replaces."""
    return list({text.split("=", 1)[0]: text for text in settings}.values())


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


def without_folder(arguments: Sequence[str]) -> list[str]:
    """Return the arguments but `run_dir=`, which names the folder of all arms."""
    return [text for text in arguments if not text.startswith("run_dir=")]
