"""What a run's folder holds, and the one way to write it: whole or not at all, through no link."""

import errno
import fcntl
import fnmatch
import glob
import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TextIO

from hitmdp_jax.errors import UsageError

CONFIG = "config.yaml"
METRICS = "metrics.csv"
EVALUATIONS = "evaluations.csv"
MADE_WITH = "made_with.txt"  # a line for whatever trained a part of the run
REPORT = "report.html"
OTHER_REPORT = "report_*.html"  # on another task
SWEEP = "sweep"  # of a sweep: its table, `.csv` and `.md`, and its figure
EVENTS = "events"  # of TensorBoard, which adds `.out.tfevents.` and more
LOCK = ".lock"  # stays; whoever trains holds it
LEFTOVER = ".*.tmp"  # of a file that was being written at a kill
POLICY = ".policy"  # ends the name of a file that holds one policy and stands for a run's folder
CHECKPOINTS, EXPORT, FIGURES = "checkpoints", "export", "figures"
SETTINGS, VIDEOS, WANDB = "settings", "videos", "wandb"

FOLDERS = (CHECKPOINTS, EXPORT, FIGURES, SETTINGS, VIDEOS, WANDB)
FILES = (
    f"{EVALUATIONS}*", f"{METRICS}*", MADE_WITH, REPORT, OTHER_REPORT, f"{SWEEP}.csv",
    f"{SWEEP}.md", f"{EVENTS}.out.tfevents.*", LEFTOVER, CONFIG,
)  # fmt: skip


def is_policy(path: Path) -> bool:
    """Return whether a path is that of a policy's file."""
    return path.suffix == POLICY and path.is_file()


def require_run(run_dir: Path) -> None:
    """Check that a folder holds a run, or a file a policy, whatever its settings are.

    Raises:
      UsageError: it does not.
    """
    if not is_policy(run_dir) and not (run_dir / CONFIG).is_file():
        raise UsageError(f"'{run_dir}' is not a run's folder: it has no {CONFIG}.")


def members(run_dir: Path) -> list[Path]:
    """Return the files that a run left in its folder, last the settings, which make it a run."""
    names = os.listdir(run_dir)
    return [run_dir / n for pattern in (*FOLDERS, *FILES) for n in fnmatch.filter(names, pattern)]


def made(folder: Path) -> Path:
    """Return a folder that a command line names, made if need be.

    Raises:
      UsageError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"run_dir = {folder} cannot be made: {error.strerror}.") from None
    return folder


def subfolder(run_dir: Path, *names: str) -> Path:
    """Return a folder inside of a run's, made if need be.

    Raises:
      OSError: it cannot be made, or a link is in its place.
    """
    folder = run_dir
    for name in names:
        folder = folder / name
        refuse_link(folder)
        folder.mkdir(exist_ok=True)
    return folder


def refuse_link(path: Path) -> None:
    """Raise OSError where a path is a link: it may lead out of a folder that a stranger made."""
    if path.is_symlink():
        raise _link(path)


def _link(path: Path) -> OSError:
    return OSError(errno.ELOOP, "it is a link, and nothing is written through one", str(path))


def check_replaceable(path: Path) -> None:
    """Check now that a file can be written after hours of work; its folder may still be missing.

    Raises:
      OSError: as `replaced`.
    """
    _refuse_other(path)
    above = next(folder for folder in path.absolute().parents if folder.exists())
    try:
        tempfile.TemporaryFile(dir=above).close()
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def _refuse_other(path: Path) -> None:
    refuse_link(path)
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is not a file", str(path))


@contextmanager
def replaced(path: Path) -> Iterator[BinaryIO]:
    """Give a file to write, which takes the place of `path` once it is whole.

    Until then it lies beside it under a name that nobody can have planted a link at. What fails
    leaves the old file as it was; a kill leaves a hidden file more, which the next writer removes.

    Raises:
      OSError: naming the file: it cannot be written, or a link or a device is in its place.
    """
    _refuse_other(path)
    _remove(path.parent, f".{glob.escape(path.name)}.{'[0-9a-f]' * 8}.tmp")
    beside = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        with _locked(beside) as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
            os.replace(beside, path)
    except BaseException as error:
        with suppress(OSError):  # where nothing may be written, nothing may be removed
            beside.unlink()
        if isinstance(error, OSError) and error.errno:
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def write(path: Path, content: str | bytes) -> None:
    """Write a file, text as UTF-8, in place of what it was; Raises as `replaced`."""
    with replaced(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


@contextmanager
def alone(run_dir: Path) -> Iterator[None]:
    """Wait for, and then keep out, others that read and replace a file of a run's folder.

    Whoever trains goes on meanwhile: that is another lock.
    """
    number = os.open(run_dir, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(number, fcntl.LOCK_EX)
        yield
    finally:
        os.close(number)


def _locked(path: Path) -> BinaryIO:
    """Make a file that `_remove` leaves alone as long as it is open."""
    while True:
        file = path.open("xb")
        with suppress(OSError):  # a file system without locks
            fcntl.flock(file, fcntl.LOCK_EX)
        if os.fstat(file.fileno()).st_nlink:  # nobody has removed it before it was locked
            return file
        file.close()


def remove_leftovers(run_dir: Path) -> None:
    """Remove what kills left of a run's files that were being written; not what still is."""
    for folder in (run_dir, *(run_dir / name for name in FOLDERS)):
        _remove(folder, LEFTOVER)


def _remove(folder: Path, leftovers: str) -> None:
    for path in filter(Path.is_file, folder.glob(leftovers)):
        with suppress(OSError), path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)  # its writer has the other one
            path.unlink()


def appending(path: Path) -> TextIO:
    """Open a text file to add lines to.

    Raises:
      OSError: naming the file: it cannot be written, or a link is in its place.
    """
    # O_NONBLOCK: a pipe in its place, which nobody reads, is refused instead of waited for.
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        number = os.open(path, flags, 0o666)
    except OSError as error:
        raise _link(path) if error.errno == errno.ELOOP else error from None
    return open(number, "a", encoding="utf-8", newline="")
