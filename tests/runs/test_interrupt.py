import os
import signal
import threading

import pytest

from hitmdp_jax.runs.interrupt import SIGNALS, InterruptedRunError, StopRequest
from tests.signals import signals_heard


@pytest.fixture(autouse=True)
def heard():
    """Have the signals heard, which the tests' own caller may have ignored."""
    with signals_heard():
        yield


@pytest.mark.parametrize("signum", SIGNALS)
def test_a_signal_becomes_a_request(signum):
    before = signal.getsignal(signum)
    with StopRequest() as stop:
        assert not stop.requested
        os.kill(os.getpid(), signum)
        assert stop.requested
        assert stop.signum == signum
        assert signal.getsignal(signum) == signal.SIG_DFL  # the second one kills
    assert signal.getsignal(signum) == before


def test_an_ignored_signal_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with StopRequest() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop.requested
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_long_call_hands_its_result_and_its_errors_on():
    def fail():
        raise KeyError("mine")

    with StopRequest() as stop:
        assert stop.wait_for(lambda: 3) == 3
        with pytest.raises(KeyError, match="mine"):
            stop.wait_for(fail)


def test_a_signal_ends_the_wait_for_a_long_call():
    over = threading.Event()

    def long():
        os.kill(os.getpid(), signal.SIGTERM)
        over.wait()

    with StopRequest() as stop, pytest.raises(InterruptedRunError) as interrupted:
        stop.wait_for(long)
    over.set()
    assert interrupted.value.signum == signal.SIGTERM
