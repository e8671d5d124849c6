"""The protocols of those who take observations, and of those who take estimates."""

from typing import Protocol, runtime_checkable

from .estimates import FrameEstimate, Prediction, Solution
from .frames import Frame
from .observations import ExpectedMotion, InertialView, Observations


class Estimator(Protocol):
    """Takes the observations of each frame and returns a Solution; the contract of every method.

    The world is the camera of the first frame. A frame with too few views gets the status lost and a
    predicted pose; the next frame with enough points starts a new map there.
    """

    name: str

    def step(self, observations: Observations) -> Solution:
        """Return the solution of the next frame; frames come in order."""


@runtime_checkable
class InertialEstimator(Protocol):
    """An estimator that uses inertial samples and predicts the motion of the camera from them."""

    @property
    def inertial_problem(self) -> str:
        """Return why the given samples are not used; empty if they are."""

    def expect(self, stamp_ns: int, view: InertialView | None) -> ExpectedMotion | None:
        """Return the motion from the latest estimate to a stamp, predicted from the samples of that frame."""

    def predict(self, stamp_ns: int, view: InertialView | None) -> Prediction | None:
        """Return pose and state at a later stamp from samples that are not kept; None if they do not reach it."""


class Sink(Protocol):
    """Watches a run frame by frame: a file, a viewer, a progress bar, a queue.

    A class that inherits it has a `close` that does nothing.
    """

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Take the estimate of the next frame, and the frame it was made from."""

    def close(self) -> None:
        """Finish: no more frames will come."""
        return None
