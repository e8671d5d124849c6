"""What a study measures: scenes under conditions, each in many trials that are judged together."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from ..geometry.se3 import Array
from .measure import stacked
from .scenes import Scene
from .trials import Progress, run_trials

Report = dict[str, Any]
Measured = dict[str, dict[str, Array]]  # label -> quantity -> values (frames,), of all trials (trials, frames)


@dataclass(frozen=True, slots=True)
class Condition(ABC):
    """A scene that is judged at `frames`; of the trials asked for, the fraction `share` is run."""

    name: str
    scene: Scene
    frames: tuple[int, ...]
    share: float = 1.0

    def trials(self, asked: int) -> int:
        """Return how many trials are run."""
        return max(2, round(asked * self.share)) if asked > 1 else 1

    @abstractmethod
    def job(self) -> Callable[[np.random.SeedSequence], Measured]:
        """Return what one trial does; picklable."""


def by_condition(
    conditions: Sequence[Condition],
    evaluate: Callable[[Measured], Report],
    trials: int,
    seed: int,
    executor: Executor | None,
    progress: Progress | None,
) -> dict[str, Report]:
    """Run every condition, and return its name -> what was run, and what `evaluate` makes of all its trials."""
    report = {}
    for condition in conditions:
        data = stacked(run_trials(condition.job(), condition.trials(trials), seed, executor, progress))
        report[condition.name] = {
            "trials": condition.trials(trials),
            "frames": list(condition.frames),
            "scene": msgspec.to_builtins(condition.scene),
            "estimators": evaluate(data),
        }
    return report


def total_trials(trials: int, conditions: Sequence[Condition]) -> int:
    """Return how many trials are run altogether."""
    return sum(c.trials(trials) for c in conditions)


def lost_share(entry: dict[str, Array]) -> float:
    """Return which part of the frames had no estimate."""
    return float(np.isnan(entry["rotation"]).mean())
