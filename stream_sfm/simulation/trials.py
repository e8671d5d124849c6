"""Monte-Carlo trials in parallel processes: the same seed gives the same numbers for any number of workers."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TypeVar

import numpy as np

Result = TypeVar("Result")
Progress = Callable[[int], None]  # called with the number of trials just finished

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def run_trials(
    job: Callable[[np.random.SeedSequence], Result],
    trials: int,
    seed: int,
    workers: int = 1,
    progress: Progress | None = None,
) -> list[Result]:
    """`job` of each trial's own seed, in order of trials; `workers` 0 runs them in this process.

    `job` must be picklable: a function of a module, or functools.partial of one. Workers use one thread each for
    linear algebra, so that sums come in one order.
    """
    seeds = np.random.SeedSequence(seed).spawn(trials)
    results: list[Result] = []
    if workers == 0:
        for s in seeds:
            results.append(job(s))
            if progress:
                progress(1)
        return results
    with _one_thread_each(), ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        for result in pool.map(job, seeds):
            results.append(result)
            if progress:
                progress(1)
    return results


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Spawned processes inherit the environment; numpy reads it when it is loaded."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
