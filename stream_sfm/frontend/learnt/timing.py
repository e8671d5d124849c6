"""The shift of views by a late right camera and a rolling shutter, predicted from the current delay and readout.

Both move a view along its velocity, eq. (70a). Only the change of this shift between frames is visible, because its
constant part is already in the points. So a resection has further unknowns: delay, readout and velocity. Before any
motion is sought, views are corrected by the delay and readout that the estimator has found. The estimator receives
uncorrected views.
"""

import numpy as np

from ... import core
from ...camera.over_image import ExposedRows
from ...camera.refinement import KnownTiming
from ...config import RigConfig
from ...geometry import Array
from ...geometry.medians import MEMORY_FRAMES
from ...geometry.stereo import StereoProjection
from ...record import changed, record
from ...rig_model.terms import AT_TIMING, prior_std

_FIRST_TURNING_RAD_S = 0.075  # the assumed angular acceleration during half of an interval of 50 ms


@record
class TurningError:
    """How much the rotation of a twist errs that is extrapolated from two motions: `mean_square` (rad/s)², an axis.

    It is learnt from `frames` frames, once the motion after each is known.
    """

    mean_square: float = _FIRST_TURNING_RAD_S**2
    frames: int = 0

    def after(self, error: Array) -> "TurningError":
        """Return the same after a twist that has erred by (6,)."""
        frames = min(self.frames + 1, MEMORY_FRAMES)
        return TurningError(self.mean_square + (float(error[3:] @ error[3:]) / 3 - self.mean_square) / frames, frames)


@record
class Timing:
    """Delay and readout: `mean` (2,) s with `cov` (2, 2).

    `std` (2,): their prior σ; `step`: the share of it that is added in quadrature to an estimator's σ. `row_of`: the
    rows of the cameras' images in which views are exposed. `twist` (6,): of the points in the last frame, None without
    a motion; `std_turning`: σ of its rotation about each axis, rad/s.
    """

    projection: StereoProjection
    row_of: ExposedRows
    std: Array
    mean: Array
    cov: Array
    step: float = RigConfig().timing_step
    twist: Array | None = None
    std_turning: float = 0.0

    @classmethod
    def unknown(
        cls,
        projection: StereoProjection,
        config: RigConfig,
        row_of: ExposedRows | None,
        known: KnownTiming | None = None,
    ) -> "Timing":
        """Return the prior; the timing of an exact rig is known."""
        row_of = ExposedRows.unknown() if row_of is None else row_of
        std = prior_std(config)[AT_TIMING] * (0.0 if config.exact else 1.0)
        if known is None or config.exact:
            return cls(projection, row_of, std, np.zeros(len(std)), np.diag(std**2), config.timing_step)
        return cls(projection, row_of, std, known.mean, np.diag(known.std**2), config.timing_step)

    def taken_out(self, points: Array, twist: Array) -> Array:
        """Return the shift (n, 4) px that is subtracted from views of homogeneous points (n, 4) with a twist (6,)."""
        if not self.mean.any():
            return np.zeros((len(points), 4))
        return core.shifts_by_timing(self.projection, self.row_of, points, twist, self.mean)

    def with_estimate(self, mean: Array, cov: Array) -> "Timing":
        """Return the timing with delay and readout N(`mean` (2,), `cov` (2, 2)), as an estimator has found them.

        The mean is weighted by the probability that it is not zero, so that insignificant values are not corrected.
        """
        if not self.std.any():
            return self
        var = cov.diagonal()
        gain = np.maximum(self.std**2 / var - 1, 0.0)
        log_odds = 0.5 * (mean**2 / var * gain / (1 + gain) - np.log1p(gain))
        probability = 0.5 + 0.5 * np.tanh(0.5 * log_odds)
        return changed(self, mean=probability * mean, cov=cov + np.diag((self.step * self.std) ** 2))
