"""What an estimator with inertial samples has in common with others: predictions, and poses without images."""

from dataclasses import replace

from ....config import Config
from ....geometry import Array
from ....types import ExpectedMotion, InertialView, Prediction, Solution, Status
from ...motion_model import MotionModel
from .inertia import Inertia


class TakesSamples:
    """The methods of every estimator that uses inertial samples; see `InertialEstimator`."""

    inertia: Inertia

    @property
    def inertial_problem(self) -> str:
        """Why inertial samples are not used."""
        return self.inertia.problem

    def expect(self, stamp_ns: int, view: InertialView | None) -> ExpectedMotion | None:
        """Return the motion that inertial samples predict for the next frame."""
        self.inertia.take(view, stamp_ns)
        return self.inertia.guiding(stamp_ns)

    def predict(self, stamp_ns: int, view: InertialView | None) -> Prediction | None:
        """Return pose and state at a later time, predicted by inertial samples."""
        return self.inertia.prediction(stamp_ns, view)

    def by_inertia_if_lost(self, solution: Solution, stamp_ns: int) -> Solution:
        """Return the solution of a frame; if it is lost, dead-reckoned by inertia as long as σ is small enough."""
        if solution.status != Status.LOST or solution.inertial is not None:
            return solution
        by_inertia = self.inertia.dead_reckoned(stamp_ns)
        if by_inertia is None:
            return solution
        reason = f"dead-reckoned by the IMU: {solution.reason}"
        return replace(solution, status=Status.DEGRADED, reason=reason, inertial=by_inertia)


class InertialMotionModel(MotionModel):
    """The motion model with inertial samples, which predict if they reach the requested time."""

    def __init__(self, config: Config, inertia: Inertia) -> None:
        super().__init__(config.motion)
        self._inertia = inertia

    def predict(self, stamp_ns: int) -> tuple[Array, Array]:
        """Predict pose (4, 4) and covariance (6, 6) by samples, eq. (81), or else as `MotionModel` does."""
        guides = self.started and self._inertia.guiding(stamp_ns) is not None
        known = self._inertia.predicted(stamp_ns) if guides else None
        if known is None:
            return super().predict(stamp_ns)
        return known.world_from_cam, known.cov_pose.copy()
