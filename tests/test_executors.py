"""Processes of this machine do what they are given, and end with the run that started them."""

import time
from collections.abc import Callable
from multiprocessing import active_children

import pytest

from stream_sfm.executors import processes
from stream_sfm.interrupts import deferred_interrupts

_LONG_S = 300


def patient(_: object) -> None:
    """A run that ends in its own time, as replays do after the current frame."""
    with deferred_interrupts():
        time.sleep(_LONG_S)


@pytest.mark.parametrize("job", [time.sleep, patient])
def test_an_interrupted_run_waits_for_no_worker(job: Callable[[float], None]) -> None:
    before = set(active_children())
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt), processes(2) as pool:
        running = [pool.submit(job, _LONG_S) for _ in range(3)]
        while not any(future.running() for future in running):
            time.sleep(0.01)
        raise KeyboardInterrupt
    assert time.monotonic() - start < _LONG_S / 3
    # A worker may be waited for by the pool's own thread at the same time, so a single join can come back early.
    deadline = time.monotonic() + _LONG_S / 3
    while not set(active_children()) <= before and time.monotonic() < deadline:
        time.sleep(0.01)
    assert set(active_children()) <= before


def test_work_is_done_in_order() -> None:
    with processes(2) as pool:
        assert list(pool.map(abs, range(-5, 0))) == [5, 4, 3, 2, 1]
