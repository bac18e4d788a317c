"""Signals as a terminal leaves them, whoever started the tests."""

import contextlib
import signal

from hitmdp_jax.runs.interrupt import SIGNALS


@contextlib.contextmanager
def signals_heard():
    """Undo meanwhile that the caller has signals ignored, as a shell has for a job behind `&`.

    Processes that are started meanwhile hear them as well: only what is ignored is inherited.
    """
    usual = {signal.SIGINT: signal.default_int_handler}
    previous = {s: signal.signal(s, usual.get(s, signal.SIG_DFL)) for s in SIGNALS}
    try:
        yield
    finally:
        for signum, handler in previous.items():
            signal.signal(signum, handler)
