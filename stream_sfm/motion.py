"""Motions between two frames, apart in what is their own and what all motions of a run err by together, eq. (74a)."""

from dataclasses import dataclass

import numpy as np

from .geometry import se3
from .geometry.se3 import Array
from .types import CommonErrors, FrameEstimate, RelativeMotions, Status


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Motion:
    """The motion from the frame of an estimate to an earlier one, to be fused or added up.

    `earlier_from_newest` (4, 4): where it is with common errors c = `mean` (m,). truth = earlier_from_newest·
    Exp(`common_jacobian` (c − mean) + own), with own ~ N(0, `cov_own` (6, 6)) and c as known, N(`mean`, `cov_common`).
    """

    earlier_from_newest: Array
    cov_own: Array
    common_jacobian: Array
    mean: Array
    cov_common: Array

    @classmethod
    def of(cls, estimate: FrameEstimate, frames: int = 1) -> "Motion | None":
        """Return the motion since `frames` frames before; None where there is none, as in the first frame."""
        if estimate.status == Status.LOST:
            return None
        return cls.to_frame(estimate.frame_index - frames, estimate.relative, estimate.common)

    @classmethod
    def to_frame(
        cls, frame_index: int, relative: RelativeMotions | None, common: CommonErrors | None
    ) -> "Motion | None":
        """Return the one of the motions of a frame that goes to the frame of an index; None where it is not there."""
        if relative is None or frame_index not in relative.frame_indices:
            return None
        row = int(np.flatnonzero(relative.frame_indices == frame_index)[0])
        pose, cov = relative.frame_from_newest[row], relative.cov[row]
        if common is None or relative.common_jacobian is None:
            return cls(pose, cov, np.zeros((6, 0)), np.zeros(0), np.zeros((0, 0)))
        j = relative.common_jacobian[row]
        return cls(pose, cov - j @ common.cov @ j.T, j, common.mean, common.cov)

    def then(self, later: "Motion") -> "Motion":
        """Return the motion over this one and a `later` one, which begins where this one ends, eq. (74b)."""
        known = self.earlier_from_newest @ se3.exp(self.common_jacobian @ (later.mean - self.mean))
        ad = se3.adjoint(se3.inverse(later.earlier_from_newest))
        return Motion(
            se3.orthonormalise(known @ later.earlier_from_newest),
            ad @ self.cov_own @ ad.T + later.cov_own,
            ad @ self.common_jacobian + later.common_jacobian,
            later.mean,
            later.cov_common,
        )

    @property
    def cov(self) -> Array:
        """The whole covariance (6, 6), of the perturbation on the right, translation first."""
        return self.cov_own + self.common_jacobian @ self.cov_common @ self.common_jacobian.T

    def __repr__(self) -> str:
        return f"<Motion of {np.linalg.norm(self.earlier_from_newest[:3, 3]):.3g} m>"
