"""The number of steps to a window's minimum, divergence, and the status if it rejects many views."""

from typing import Any

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.config import Config, WindowConfig
from stream_sfm.estimators.window import cross_frame
from stream_sfm.estimators.window import minimise as minimising
from stream_sfm.estimators.window.minimise import minimised
from stream_sfm.estimators.window.state import WindowState
from stream_sfm.record import changed
from stream_sfm.types import Status
from tests.helpers.estimators import run


class Steps:
    """A state whose steps predict given decreases; it records the calls."""

    def __init__(self, decreases: list[float], is_timed: bool) -> None:
        self.decreases, self.is_timed, self.points, self.done = decreases, is_timed, [1], ""

    def stepped(self) -> tuple["Steps", float]:
        self.done += "s"
        return self, self.decreases[self.done.count("s") - 1]

    def with_call(self, call: str) -> "Steps":
        self.done += call
        return self


@pytest.fixture
def of_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replaces what `minimised` does with a state by what it does with `Steps`."""
    monkeypatch.setattr(minimising, "is_timed", lambda steps: steps.is_timed)
    monkeypatch.setattr(minimising, "without_undetermined", lambda steps: steps)
    monkeypatch.setattr(minimising, "gauss_newton_step", Steps.stepped)
    monkeypatch.setattr(minimising, "gated", lambda steps, _: steps.with_call("g"))
    monkeypatch.setattr(minimising, "renewed_timing", lambda steps: steps.with_call("r"))


@pytest.mark.parametrize(
    ("decreases", "is_timed", "done"),
    [
        ([5.0], False, "sg"),
        ([1e6, 5.0], False, "sgsg"),
        ([5.0, 0.1], True, "sgrsgr"),  # views are gated with the velocities of the minimum
        ([5.0, 60.0], True, "sgrsgr"),  # new velocities have moved the minimum, which is no divergence
        ([1e6, 2e5, 5.0], True, "sgrsgrsgr"),
    ],
)
def test_steps_end_once_the_predicted_decrease_is_small(
    decreases: list[float], is_timed: bool, done: str, of_steps
) -> None:
    steps: Any = Steps(decreases, is_timed)
    assert minimised(steps, WindowConfig(max_iterations=10), 0.99) == (steps, len(decreases))
    assert steps.done == done


def test_a_step_that_gating_enlarges_is_no_divergence_however_late_the_iteration_ends(of_steps) -> None:
    steps: Any = Steps([1e6, 1e-2, 40.0, 1e-4], is_timed=False)
    assert minimised(steps, WindowConfig(max_iterations=10, converged=1e-3), 0.99) == (steps, 4)


@pytest.mark.parametrize(
    ("decreases", "is_timed"),
    [([1e5, 1e6], False), ([1e5, 1e6], True), ([5.0, 1e5], True), ([np.nan], False), ([5.0, np.nan], True)],
)
def test_diverging_steps_end_the_map(decreases: list[float], is_timed: bool, of_steps) -> None:
    steps: Any = Steps(decreases, is_timed)
    with pytest.raises(np.linalg.LinAlgError, match="diverges"):
        minimised(steps, WindowConfig(max_iterations=10), 0.99)


def test_a_frame_is_degraded_if_the_joint_minimum_rejects_its_views(arc, monkeypatch) -> None:
    """The motion since the previous frame agrees with nearly all; points that begin there do not determine the pose."""
    config, last = Config(), arc.observations[-1].frame_index

    def refuse(current: WindowState, *settings: Any) -> tuple[WindowState, int]:
        current, steps = minimised(current, *settings)
        if current.frames[-1].index == last:
            views = current.views
            known = core.among(views.ids, current.marginals.ids) & (views.frame == len(current.frames) - 1)
            used = views.used & ~(known & (np.cumsum(known & views.used) > 11))
            current = changed(current, views=changed(views, used=used))
        return current, steps

    monkeypatch.setattr(cross_frame, "minimised", refuse)
    *before, refused = run("cross-frame", arc.projection, arc.observations, config)
    assert before[-1].status is Status.OK
    assert refused.status is Status.DEGRADED and "only 11 accepted views" in refused.reason
