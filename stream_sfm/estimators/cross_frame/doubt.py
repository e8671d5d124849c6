"""What the newest pose does not know beside the joint covariance: other motions, and patches that slide alike."""

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

    `cov` (6, 6): of second motions that may have been the camera's, one in each of the last `frames`, and
    `cov_slides` (6, 6) of turns that patches have feigned which slid alike.
    """

    cov: Array = field(default_factory=_none)
    cov_slides: Array = field(default_factory=_none)
    frames: int = 0

    def seen_from(self, cam_from_ref: Array) -> "Doubt":
        """Return the same in axes of another reference camera (4, 4)."""
        ad = se3.adjoint(cam_from_ref)
        return changed(self, cov=ad @ self.cov @ ad.T, cov_slides=ad @ self.cov_slides @ ad.T)

    def with_slide(self, cam_from_ref: Array, std_turn_rad: float) -> "Doubt":
        """Return it with a turn of σ about each axis that patches feign in a camera (4, 4)."""
        turns = std_turn_rad * se3.adjoint(se3.inverse(cam_from_ref))[:, 3:]
        return changed(self, cov_slides=self.cov_slides + turns @ turns.T)

    def with_second(self, motion: Resection, std_moved: Array, cam_from_ref: Array) -> tuple["Doubt", Array | None]:
        """Return it with the second of two plausible motions, if there is one, which led to a camera (4, 4).

        No vehicle moves between two frames by much more than `std_moved` (6,) otherwise than it did.

        The difference of the two, in any direction, as the camera's motion may be that of a third set, which is hidden;
        and the error of the second, eq. (36a). The differences of frames in a row have one sign. Where what is followed
        may have been a body for some frames already, their motions may be wrong by as much. Also returns the
        `ambiguity` of the frame.
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
        modes[:, 6:] *= frames - self.frames  # so much is known of the camera's motion in all of these
        return changed(self, cov=self.cov + modes @ modes.T, frames=frames), ambiguity

    def of_newest(self, cam_from_ref: Array) -> Array:
        """Return what it adds to the covariance (6, 6) of the newest pose, that of a camera (4, 4)."""
        ad = se3.adjoint(cam_from_ref)
        return np.asarray(ad @ (self.cov + self.cov_slides) @ ad.T)
