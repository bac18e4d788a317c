"""Stopping a run by a signal: politely at the first one, at once at the second."""

import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from types import FrameType
from typing import Any, TypeVar

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
Result = TypeVar("Result")


class InterruptedRunError(Exception):
    """The run was asked to stop while there was nothing to save yet."""

    def __init__(self, signum: int):
        super().__init__(signum)
        self.signum = signum


class StopRequest:
    """Turns the first SIGINT, SIGTERM or SIGHUP into a request; a second one kills.

    A context: handlers are in place inside it. Where the caller has a signal ignored (`nohup`), or
    outside the main thread, things stay as they are.
    """

    def __init__(self) -> None:
        self.signum: int | None = None  # the signal that asked
        self._previous: dict[int, Any] = {}

    @property
    def requested(self) -> bool:
        """Whether the run should end."""
        return self.signum is not None

    def __enter__(self) -> "StopRequest":
        if threading.current_thread() is threading.main_thread():
            for signum in SIGNALS:
                if signal.getsignal(signum) is not signal.SIG_IGN:
                    self._previous[signum] = signal.signal(signum, self._request)
        return self

    def __exit__(self, *error: object) -> None:
        for signum, handler in self._previous.items():
            signal.signal(signum, handler)

    def _request(self, signum: int, frame: FrameType | None) -> None:
        self.signum = signum
        for other in self._previous:
            signal.signal(other, signal.SIG_DFL)
        # Not print: the signal may have come in the middle of one.
        os.write(2, b"\nStopping and saving after this iteration. A second signal stops at once.\n")

    def wait_for(self, function: Callable[[], Result]) -> Result:
        """Run a function that may take long and cannot stop, such as a compilation.

        It runs in a thread of its own, since Python hears signals in the main thread alone, and not
        while that is inside of a compiler.

        Raises:
          InterruptedRunError: the request came first. The thread is left behind: end the process.
        """
        if threading.current_thread() is not threading.main_thread():
            return function()
        outcome = Future[Result]()

        def work() -> None:
            try:
                outcome.set_result(function())
            except BaseException as error:
                outcome.set_exception(error)

        threading.Thread(target=work, daemon=True).start()
        while not wait([outcome], timeout=0.1).done:
            if self.signum is not None:
                raise InterruptedRunError(self.signum)
        return outcome.result()
