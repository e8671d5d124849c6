"""Each method on two halves of the tracks, even and odd: what its errors and covariances are, without any truth.

The observations are those of one front-end, so what all tracks of a frame share, above all the calibration, is the same
in both halves and cannot be seen.
"""

import numpy as np

from ..config import Config
from ..errors import StreamSfmError
from ..estimators import make_estimator
from ..geometry import se3
from ..geometry.linear import mahalanobis2
from ..geometry.stereo import StereoProjection
from ..report.records import HalvesRecord
from ..types import Observations, Solution, Status
from .self_test import part_of

MOST_FRAMES = 200  # enough for spans of fifty, and bounded time


class Halves:
    """Takes observations frame by frame. If the estimator fails on either half, `record` ends there."""

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self._pair = [make_estimator(config.method, projection, config) for _ in range(2)]
        self.method, self.record = config.method, HalvesRecord()
        self.failed = False

    def take(self, observations: Observations) -> None:
        """Estimate the next frame from each half."""
        if self.failed:
            return
        even = observations.track_ids % 2 == 0
        try:
            found = [e.step(part_of(observations, rows)) for e, rows in zip(self._pair, (even, ~even), strict=True)]
        except (ArithmeticError, ValueError, LookupError, StreamSfmError):
            self.failed = True
            return
        if Status.LOST in (found[0].status, found[1].status):
            self.record.add(np.full((2, 4, 4), np.nan), float("nan"))
        else:
            self.record.add(np.stack([half.world_from_cam for half in found]), _nees(*found))


def _nees(one: Solution, other: Solution) -> float:
    """The difference of two poses in their joint covariance, 6 expected; NaN where they have none, as at the start."""
    cov = one.cov_pose + other.cov_pose
    if not (np.isfinite(cov).all() and (np.diag(cov) > 0).all()):
        return float("nan")
    apart = se3.log(se3.inverse(one.world_from_cam) @ other.world_from_cam)
    return float(mahalanobis2(apart[None], cov[None])[0])
