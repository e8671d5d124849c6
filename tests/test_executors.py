"""Worker processes do their jobs, and end with the run that started them."""

import time
from collections.abc import Callable
from multiprocessing import active_children
from pathlib import Path

import pytest

from stream_sfm.system.executors import processes
from stream_sfm.system.interrupts import deferred_interrupts


def asleep(begun: Path) -> None:
    begun.touch()
    time.sleep(60)
    begun.with_suffix(".ended").touch()


def patient(begun: Path) -> None:
    """A run that ends in its own time, as replays do after the current frame."""
    with deferred_interrupts():
        asleep(begun)


@pytest.mark.parametrize("job", [asleep, patient])
def test_an_interrupted_run_waits_for_no_worker(job: Callable[[Path], None], tmp_path: Path) -> None:
    before = set(active_children())
    with pytest.raises(KeyboardInterrupt), processes(2) as pool:
        begun = [tmp_path / str(number) for number in range(3)]
        for file in begun:
            pool.submit(job, file)
        while sum(file.exists() for file in begun) < 2:  # the third has no worker
            time.sleep(0.01)
        workers = set(active_children()) - before
        raise KeyboardInterrupt
    for worker in workers:
        worker.join()
    assert len(workers) == 2
    # The pool's own thread reaps workers too, so that their exit codes may be unknown here.
    assert not list(tmp_path.glob("*.ended"))
