"""A run's folder: who may write into it, what it holds already, and how a new one is named."""

import fcntl
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hitmdp_jax import plugins
from hitmdp_jax.errors import UsageError
from hitmdp_jax.machine import MADE_WITH
from hitmdp_jax.training.checkpoint import saved_iterations
from hitmdp_jax.training.config import RunConfig

CONFIG = "config.yaml"
RUNS = Path("runs")


def default_folder(config: RunConfig) -> Path:
    """Return `runs/<env>/<algo>/<time>` of a run that starts now."""
    names = [plugins.label(x["name"]) for x in (*config.tasks[:1], config.algo)]
    return RUNS.joinpath(*names, time.strftime("%Y-%m-%d_%H-%M-%S"))


def made(folder: Path) -> Path:
    """Return a folder, made if need be.

    Raises:
      UsageError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"run_dir = {folder} cannot be made: {error.strerror}.") from None
    return folder


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
    folder = run_dir or default_folder(config)
    number = 1
    while True:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if overwrite and (folder / CONFIG).is_file():
                with locked(folder):
                    clear(folder)
            with (folder / CONFIG).open("x") as file:  # one of two that start together gets it
                file.write(config.to_yaml())
            return folder
        except FileExistsError:
            if run_dir is not None and (folder / CONFIG).exists():
                raise UsageError(
                    f"'{folder}' holds a run already: resume={folder} goes on with it, "
                    "overwrite=true replaces it."
                ) from None
            if run_dir is not None:
                raise UsageError(f"run_dir = {folder} is not a folder.") from None
            number += 1
            folder = default_folder(config)
            folder = folder.with_name(f"{folder.name}_{number}")
        except OSError as error:
            raise UsageError(f"run_dir = {folder} cannot be written: {error.strerror}.") from None


def clear(folder: Path) -> None:
    """Remove what a run leaves in its folder, and nothing else."""
    for name in ("checkpoints", "figures", "settings", "videos", "wandb"):
        shutil.rmtree(folder / name, ignore_errors=True)
    files = (
        "metrics.csv", "evaluations.csv", "sweep.*", "events.out.tfevents.*", MADE_WITH, CONFIG
    )  # fmt: skip
    for pattern in files:
        for path in folder.glob(pattern):
            path.unlink()


@contextmanager
def locked(run_dir: Path) -> Iterator[None]:
    """Keep other processes from writing into a run's folder meanwhile; a killed one lets go.

    Raises:
      UsageError: another process is writing into it, or nobody may.
    """
    try:
        file = (run_dir / ".lock").open("w")
    except OSError as error:
        raise UsageError(f"'{run_dir}' cannot be written: {error.strerror}.") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UsageError(f"'{run_dir}' is being written by another process.") from None
        yield


def is_finished(run_dir: Path, config: RunConfig) -> bool:
    """Return whether a run has saved its last iteration."""
    return max(saved_iterations(run_dir), default=0) >= config.last_iteration


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
    """Return the run under a folder that was written last.

    Raises:
      UsageError: there is none.
    """
    runs = [path.parent for path in root.rglob(CONFIG)]
    if not runs:
        raise UsageError(f"resume=latest finds no run under '{root}'.")
    files = ("metrics.csv", CONFIG)
    times = {run: [(run / f).stat().st_mtime for f in files if (run / f).exists()] for run in runs}
    return max(runs, key=lambda run: max(times[run]))
