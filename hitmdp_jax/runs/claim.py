"""Who may write into a run's folder, what it holds already, and how a new one is named."""

import contextlib
import fcntl
import itertools
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

from hitmdp_jax import plugins
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.checkpoint import Checkpoints, saved_iterations
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import (
    CONFIG,
    LOCK,
    METRICS,
    appending,
    members,
    refuse_link,
    remove_leftovers,
    write,
)
from hitmdp_jax.runs.schedule import Schedule

RUNS = Path("runs")


class BusyError(UsageError):
    """Another process is writing into a run's folder."""


def default_folder(config: RunConfig, number: int = 1) -> Path:
    """Return `runs/<env>/<algo>/<time>` of the first, second, ... run that starts now."""
    names = [plugins.label(x["name"]) for x in (*config.tasks[:1], config.algo)]
    more = f"_{number}" if number > 1 else ""
    return RUNS.joinpath(*names, time.strftime("%Y-%m-%d_%H-%M-%S") + more)


def claim(run_dir: Path | None, config: RunConfig, overwrite: bool = False) -> Path:
    """Make a new run's folder and write its settings there, so that no other run takes it.

    Args:
      run_dir: the folder; None takes the default name, or the next free one beside it.
      config: the run's settings.
      overwrite: replace what an earlier run left there.

    Returns:
      The folder.

    Raises:
      UsageError: the folder holds a run, or cannot be written.
    """
    for number in itertools.count(1):
        folder = run_dir or default_folder(config, number)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with locked(folder):  # one of two that start together gets it
                if overwrite and (folder / CONFIG).is_file():
                    clear(folder)
                if not (folder / CONFIG).exists():
                    write(folder / CONFIG, config.to_yaml())
                    return folder
        except BusyError:
            if run_dir is not None:
                raise
        except FileExistsError:
            raise UsageError(f"run_dir = {folder} is not a folder.") from None
        except OSError as error:
            raise UsageError(f"run_dir = {folder} cannot be written: {error.strerror}.") from None
        if run_dir is not None:
            raise UsageError(
                f"'{folder}' already holds a run: resume={folder} continues it, "
                "overwrite=true replaces it."
            )
    raise AssertionError  # `count` does not end


def clear(folder: Path) -> None:
    """Remove what a run leaves in its folder, and nothing else."""
    for path in members(folder):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


@contextlib.contextmanager
def locked(run_dir: Path) -> Iterator[None]:
    """Keep other processes from writing into a run's folder meanwhile; a killed one lets go.

    Raises:
      UsageError: another process is writing into it, nobody may, or a part of it is a link.
    """
    try:
        for path in members(run_dir):
            refuse_link(path)
        file = appending(run_dir / LOCK)
    except OSError as error:
        name = error.filename or run_dir
        raise UsageError(f"'{name}' cannot be written: {error.strerror}.") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise BusyError(f"'{run_dir}' is being written by another process.") from None
        remove_leftovers(run_dir)
        yield


def is_finished(run_dir: Path, schedule: Schedule) -> bool:
    """Return whether a run has saved its last iteration, in a checkpoint that can be read."""
    newest = max(saved_iterations(run_dir), default=0)
    if newest < schedule.last_iteration:
        return False
    with contextlib.closing(Checkpoints(run_dir, read_only=True)) as checkpoints:
        return checkpoints.is_whole(newest)


def already_there(run_dir: Path, config: RunConfig) -> bool:
    """Return whether a folder holds a run of exactly these settings, finished or not.

    Raises:
      UsageError: it holds a run of other settings; says which.
    """
    if not (run_dir / CONFIG).is_file():
        return False
    differences = config.differences(RunConfig.load(run_dir))
    if differences:
        raise UsageError(
            f"'{run_dir}' holds a run with other settings ({'; '.join(differences)}): "
            "name another run_dir."
        )
    return True


def newest(root: Path = RUNS) -> Path:
    """Return the run under a folder that was written last, of those that have saved something.

    Raises:
      UsageError: there is none.
    """
    # Its path is printed, and may be a stranger's choice.
    paths = [path for path in root.rglob(CONFIG) if str(path).isprintable()]
    runs = [path.parent for path in paths if saved_iterations(path.parent)]
    if not runs:
        none = f"there is none under '{root}' that has saved anything"
        raise UsageError(f"latest names no run: {none}.")
    files = (METRICS, CONFIG)
    times = {run: [(run / f).stat().st_mtime for f in files if (run / f).exists()] for run in runs}
    return max(runs, key=lambda run: max(times[run]))
