"""Uncertainty of the newest pose beyond the joint covariance: alternative motions, and patches that slide alike."""

from dataclasses import field

import numpy as np

from ...geometry import Array, se3
from ...geometry.linear import Cholesky, scaled_cholesky
from ...geometry.resection import Resection
from ...record import changed, record


def _none() -> Array:
    return np.zeros((6, 6))


@record
class Doubt:
    """A block of a map's state, in axes of the reference camera.

    `cov` (6, 6): of second motions, any of which may have been the camera's, one in each of the last `frames`.
    `cov_slides` (6, 6): of apparent rotations by patches that slid alike.
    """

    cov: Array = field(default_factory=_none)
    cov_slides: Array = field(default_factory=_none)
    frames: int = 0

    def seen_from(self, cam_from_ref: Array) -> "Doubt":
        """Return the same in axes of another reference camera (4, 4)."""
        ad = se3.adjoint(cam_from_ref)
        return changed(self, cov=ad @ self.cov @ ad.T, cov_slides=ad @ self.cov_slides @ ad.T)

    def with_slide(self, cam_from_ref: Array, std_turn_rad: float) -> "Doubt":
        """Return it with an apparent rotation by sliding patches, of this σ about each axis of a camera (4, 4)."""
        turns = std_turn_rad * se3.adjoint(se3.inverse(cam_from_ref))[:, 3:]
        return changed(self, cov_slides=self.cov_slides + turns @ turns.T)

    def with_second(self, motion: Resection, std_moved: Array, cam_from_ref: Array) -> tuple["Doubt", Array | None]:
        """Return it with the second of two plausible motions to a camera (4, 4), if there is one, and the `ambiguity`.

        `std_moved` (6,): σ of the change of a vehicle's motion between two frames.

        Added are the difference of the two motions, in any direction, as the camera may have moved with a third set of
        views that is hidden, and the error of the second motion, eq. (36a). The differences of consecutive frames have
        the same sign. If the camera's motion may have been confused with that of a body for some frames already, the
        motions of these frames may be wrong by as much.
        """
        second = motion.ambiguous
        if second is None:
            return changed(self, frames=0), None
        frames = max(self.frames, second.lasted) + 1
        first_from_second = motion.cam_from_ref @ se3.inverse(second.cam_from_ref)  # of the newest camera
        apart = np.linalg.norm(se3.log(first_from_second).reshape(2, 3), axis=1)
        apart = np.minimum(apart, std_moved[[0, 3]])
        cov = Cholesky(Cholesky(second.cov_pose).inverse() + np.diag(std_moved**-2.0)).inverse()
        own = se3.adjoint(first_from_second) @ scaled_cholesky(cov)
        ambiguity = np.concatenate([np.diag(np.repeat(apart, 3)), own], axis=1)
        modes = se3.adjoint(se3.inverse(cam_from_ref)) @ ambiguity
        modes[:, :6] *= np.sqrt(frames**2 - self.frames**2)  # n frames of one sign: n²
        modes[:, 6:] *= frames - self.frames  # the second motion is known this well in each of these frames
        return changed(self, cov=self.cov + modes @ modes.T, frames=frames), ambiguity

    def of_newest(self, cam_from_ref: Array) -> Array:
        """Return its contribution to the covariance (6, 6) of the newest pose, that of a camera (4, 4)."""
        ad = se3.adjoint(cam_from_ref)
        return np.asarray(ad @ (self.cov + self.cov_slides) @ ad.T)
