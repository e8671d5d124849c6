"""How many steps a window makes, and when they lead away from its minimum."""

from typing import Any

import numpy as np
import pytest

from stream_sfm.estimators.cross_frame import minimise as module
from stream_sfm.estimators.cross_frame.minimise import minimise


class Steps:
    """A map whose steps promise given decreases; it notes what is done to it."""

    def __init__(self, decreases: list[float], is_timed: bool) -> None:
        self.decreases, self.is_timed, self.ids, self.done = decreases, is_timed, [1], ""

    def drop_undetermined(self) -> None:
        pass

    def gauss_newton_step(self) -> float:
        self.done += "s"
        return self.decreases[self.done.count("s") - 1]

    def renew_timing(self) -> None:
        self.done += "r"


@pytest.fixture(autouse=True)
def gates(monkeypatch: pytest.MonkeyPatch) -> None:
    def gate(current: Any, _: float) -> None:
        current.done += "g"

    monkeypatch.setattr(module, "_gate", gate)


@pytest.mark.parametrize(
    ("decreases", "is_timed", "done"),
    [
        ([5.0], False, "sg"),
        ([1e6, 5.0], False, "sgsg"),
        ([5.0, 0.1], True, "sgrsgr"),  # views are judged by the velocities that they were estimated with
        ([5.0, 60.0], True, "sgrsgr"),  # new velocities have moved the minimum, which is no divergence
        ([1e6, 2e5, 5.0], True, "sgrsgrsgr"),
    ],
)
def test_steps_end_where_they_promise_little(decreases: list[float], is_timed: bool, done: str) -> None:
    steps: Any = Steps(decreases, is_timed)
    assert minimise(steps, 10, 0.99) == len(decreases)
    assert steps.done == done


@pytest.mark.parametrize(
    ("decreases", "is_timed"),
    [([1e5, 1e6], False), ([1e5, 1e6], True), ([5.0, 1e5], True), ([np.nan], False), ([5.0, np.nan], True)],
)
def test_steps_that_lead_away_end_the_map(decreases: list[float], is_timed: bool) -> None:
    steps: Any = Steps(decreases, is_timed)
    with pytest.raises(np.linalg.LinAlgError, match="diverges"):
        minimise(steps, 10, 0.99)
