"""A run notices a signal between two frames; a second one ends it at once."""

import os
import signal
import threading

import pytest

from stream_sfm.interrupts import deferred_interrupts


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_is_a_request_and_the_second_acts(number: signal.Signals) -> None:
    def act(*_: object) -> None:
        raise InterruptedError("acted")

    before = signal.signal(number, act)
    try:
        with deferred_interrupts() as interruption:
            assert not interruption.requested
            os.kill(os.getpid(), number)
            assert interruption.requested
            with pytest.raises(InterruptedError, match="acted"):
                os.kill(os.getpid(), number)
        assert signal.getsignal(number) is act
    finally:
        signal.signal(number, before)


def test_in_another_thread_signals_are_left_alone() -> None:
    handlers = []

    def run() -> None:
        with deferred_interrupts() as interruption:
            handlers.append((signal.getsignal(signal.SIGINT), interruption.requested))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert handlers == [(signal.getsignal(signal.SIGINT), False)]
