"""A test that hangs fails."""

import signal

import pytest


@pytest.fixture(autouse=True)
def _deadline():
    """Ends only what hangs: the longest of these tests take a minute on a busy machine."""

    def late(*_: object) -> None:
        raise TimeoutError("this hangs")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(1800)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)
