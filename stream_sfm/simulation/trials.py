"""Monte-Carlo trials in this process or in many: the same seed gives the same numbers everywhere."""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import TypeVar

import numpy as np

Result = TypeVar("Result")
Progress = Callable[[int], None]  # called with the number of trials just finished


def run_trials(
    job: Callable[[np.random.SeedSequence], Result],
    trials: int,
    seed: int,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> list[Result]:
    """Return `job` of each trial's own seed, in the order of trials, run by `executor` or (None) in this process.

    `job` must be picklable: a function of a module, or functools.partial of one.
    """
    seeds = np.random.SeedSequence(seed).spawn(trials)
    results: list[Result] = []
    for result in executor.map(job, seeds) if executor else map(job, seeds):
        results.append(result)
        if progress:
            progress(1)
    return results
