"""Sinks for tests."""

from collections.abc import Callable
from typing import Any

from stream_sfm.types import Frame, FrameEstimate


class Calling:
    """A sink that calls a function with each estimate."""

    def __init__(self, function: Callable[[FrameEstimate], Any]) -> None:
        self.function = function
        self.closed = 0

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        self.function(estimate)

    def close(self) -> None:
        self.closed += 1
