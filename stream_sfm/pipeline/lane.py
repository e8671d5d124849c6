"""One estimator behind an observer: `Engine` has one of them, a run one per method (`run/lane.py`)."""

import time

from ..rig_model.estimate import RigEstimate
from ..types import (
    Estimator,
    ExpectedMotion,
    Frame,
    FrameEstimate,
    InertialEstimator,
    InertialView,
    Solution,
    StereoFrame,
)
from .observer import Observed, Observer


class BareLane:
    """Makes estimates from the observations of an observer, frame by frame, without record and files.

    `inertial`: the estimator if it takes inertial samples, else None; `solution`: that of the latest frame, None if the
    estimator failed; `rig`: its estimate of the rig so far; `spent_s`: the CPU time of the estimator.
    """

    def __init__(self, observer: Observer, estimator: Estimator) -> None:
        self.observer = observer
        self._use(estimator)
        self.solution: Solution | None = None
        self.rig: RigEstimate | None = None
        self.spent_s = 0.0

    def _use(self, estimator: Estimator) -> None:
        self.estimator = estimator
        # asked here, as a protocol takes 10 µs to answer
        self.inertial = estimator if isinstance(estimator, InertialEstimator) else None

    def expect(self, stamp_ns: int, view: InertialView) -> ExpectedMotion | None:
        """Return the motion up to a frame as its inertial samples predict it; None if the method takes none."""
        return None if self.inertial is None else self.inertial.expect(stamp_ns, view)

    def predicts(self, frame: Frame) -> bool:
        """Whether `expect` is asked about a frame, which then needs the estimates of all frames before."""
        samples = frame.imu if isinstance(frame, StereoFrame) else None
        return samples is not None and self.inertial is not None

    def estimate(self, observed: Observed) -> FrameEstimate:
        """Return the estimate of the next frame, in axes of the physical left camera."""
        self.solution = None
        began_s = time.thread_time()  # CPU time, as other lanes run beside this one
        solution = self.estimator.step(observed.observations)
        took_s = time.thread_time() - began_s
        self.spent_s += took_s
        self.solution, self.rig = solution, solution.rig or self.rig
        return self.observer.physical.estimate(observed, solution, 1e3 * took_s)
