"""How every command line ends: with a sentence where its user, the disk or the terminal fails."""

import argparse
import errno
import importlib
import logging
import os
import resource
import signal
import sys
import threading
from collections.abc import Callable
from types import ModuleType
from typing import Any, TextIO

from hitmdp_jax.errors import UsageError, exit_with, warn

# Errors of the machine that name no file, and need no traceback.
OF_THE_MACHINE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EMFILE, errno.ENFILE)

OPEN_FILES = 64  # that a process must be allowed; a training holds about 30


def guarded(command: Callable[[], int | None], shows: bool = True) -> None:
    """Run a command line: one sentence and exit code 2 where its user or the disk is at fault.

    Args:
      command: returns the exit code.
      shows: whether what it prints is what it is for: where that is lost, the exit code is 1.
    """
    threading.excepthook = _say_in_a_line
    logging.getLogger("absl").setLevel(logging.CRITICAL)  # what Orbax logs, `Checkpoints` says
    output = sys.stdout = Output(_opened(sys.stdout))
    try:
        check_process()
        code = command()
    except UsageError as error:
        exit_with(error)
    except KeyboardInterrupt:
        print("Stopped.", file=sys.stderr)
        sys.exit(128 + signal.SIGINT)
    except OSError as error:
        if error.filename is not None:
            exit_with(UsageError(f"'{error.filename}' cannot be used: {error.strerror}."))
        if error.errno not in OF_THE_MACHINE:
            raise
        exit_with(UsageError(f"This machine cannot continue: {error.strerror}."))
    except (MemoryError, RuntimeError) as error:  # JAX's own is one
        if not isinstance(error, MemoryError) and "RESOURCE_EXHAUSTED" not in str(error):
            raise
        reason = "This machine does not have enough memory"
        exit_with(UsageError(f"{reason}: lower seeds, num_envs, rollout_length or episodes."))
    finally:
        output.flush()
        sys.stdout = output.stream
    if code or (shows and output.failed):
        sys.exit(code or 1)


def work(command: str, arguments: argparse.Namespace) -> int | None:
    """Do what a command line that was read says; return the exit code."""
    return work_of(command).run(arguments)


def work_of(command: str) -> ModuleType:
    """Import, once a command line is read, what does its work; it takes seconds.

    Every core is presented to JAX as a device: a task or an algorithm of the user's own may compute
    as soon as its file is run, and nothing can be set up after that.
    """
    import hitmdp_jax.quiet_mjx  # noqa: F401  # before whatever of this imports Brax

    module = importlib.import_module(f"hitmdp_jax.cli.{command}")
    from hitmdp_jax.runs.host import present_cores

    present_cores()
    return module


def dispatched(usage: Callable[[], str], command: Callable[[str, list[str]], int]) -> None:
    """Run a command line `NAME [argument ...]`; without a name, print its usage."""

    def run() -> int:
        arguments = sys.argv[1:]
        if not arguments or {"-h", "--help"} & set(arguments):
            print(usage())
            return 0
        return command(arguments[0], arguments[1:])

    guarded(run)


class Output:
    """Standard output that ends nothing: once it fails, which is said, what is written is dropped.

    Whoever read a pipe may have gone, a disk may be full. Letters that a terminal does not know are
    written as question marks.

    Args:
      stream: the stream that it stands for.
    """

    def __init__(self, stream: TextIO):
        self.stream, self.failed = stream, False
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # pyright: ignore

    def write(self, text: str) -> int:
        """Write, or drop, some text."""
        self._attempt(lambda: self.stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Hand over what was written."""
        self._attempt(self.stream.flush)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def _attempt(self, action: Callable[[], object]) -> None:
        if self.failed:
            return
        try:
            action()
        except OSError as error:
            self.failed = True
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.stream.fileno())  # for what is kept back
            if not isinstance(error, BrokenPipeError):  # who read it has gone, as `head` does
                warn(f"nothing more can be printed: {error.strerror}")


def _opened(stream: TextIO | None) -> TextIO:
    """Return a standard stream; where it was closed, nothing, so that no file takes its number."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    return stream or open(os.devnull, "w")


def check_process() -> None:
    """Raise UsageError where the process has no folder to work in, or may open too few files."""
    try:
        os.getcwd()
    except FileNotFoundError:
        raise UsageError(
            "The working directory has been deleted: change to one that exists."
        ) from None
    files, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= files < OPEN_FILES:
        if 0 <= most < OPEN_FILES:
            raise UsageError(f"ulimit -n = {most} must be at least {OPEN_FILES} open files.")
        resource.setrlimit(resource.RLIMIT_NOFILE, (OPEN_FILES, most))


def _say_in_a_line(args: threading.ExceptHookArgs) -> None:
    """Report what ended a thread that writes in the background: a full disk needs no traceback."""
    if isinstance(args.exc_value, OSError):
        warn(args.exc_value)
    else:
        threading.__excepthook__(args)
