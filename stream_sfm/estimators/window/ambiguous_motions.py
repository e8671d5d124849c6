"""Uncertainty of the newest pose beyond the joint covariance: alternative motions, and patches that slide alike."""

from dataclasses import field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array, se3
from ...geometry.linear import Cholesky, scaled_cholesky
from ...geometry.resection import MANY_VIEWS, Resection
from ...record import changed, record

_MOST = 128  # motions that are remembered
# Share of the tracks of a motion that confirm it. In front of tiles, with depths of a tile off, half of them agreed
# afterwards as well: 62 ok poses were wrong by 39 mm at σ 16. Of right motions 70 to 90 % do.
_MOST_TRACKS = 2 / 3


class AmbiguousMotion(NamedTuple):
    """A motion beside which there was a second one: the `ids` (n,) of its tracks, and the `cov` (6, 6) after it."""

    ids: NDArray[np.int64]
    cov: Array


def _none() -> Array:
    return np.zeros((6, 6))


@record
class AmbiguousMotions:
    """A block of a map's state, in axes of the reference camera.

    `cov` (6, 6): of second motions, any of which may have been the camera's, one in each of the last `frames`;
    `motions`: those that were followed; `after` (n,): the tracks of the first frame after them, None in these frames.
    `cov_slides` (6, 6): of apparent rotations by patches that slid alike.
    `cov_left` (6, 6): of second motions that were not excluded when later ones were.
    """

    cov: Array = field(default_factory=_none)
    cov_slides: Array = field(default_factory=_none)
    frames: int = 0
    motions: tuple[AmbiguousMotion, ...] = ()
    after: NDArray[np.int64] | None = None
    cov_left: Array = field(default_factory=_none)

    def seen_from(self, cam_from_ref: Array) -> "AmbiguousMotions":
        """Return the same in axes of another reference camera (4, 4)."""
        ad = se3.adjoint(cam_from_ref)
        covs = {name: ad @ getattr(self, name) @ ad.T for name in ("cov", "cov_slides", "cov_left")}
        return changed(self, motions=tuple(m._replace(cov=ad @ m.cov @ ad.T) for m in self.motions), **covs)

    def with_slide(self, cam_from_ref: Array, std_turn_rad: float) -> "AmbiguousMotions":
        """Return the same with a rotation by sliding patches, of this σ about each axis of a camera (4, 4)."""
        turns = std_turn_rad * se3.adjoint(se3.inverse(cam_from_ref))[:, 3:]
        return changed(self, cov_slides=self.cov_slides + turns @ turns.T)

    def with_second(
        self, motion: Resection, std_moved: Array, cam_from_ref: Array, ids: NDArray[np.int64]
    ) -> tuple["AmbiguousMotions", Array | None]:
        """Return the same with the second of two plausible motions to a camera (4, 4), if any, and the `ambiguity`.

        `std_moved` (6,): σ of the change of a vehicle's motion between two frames; `ids` (n,): the tracks of the first
        motion.

        Added are the difference of the two motions, in any direction, as the camera may have moved with a third set of
        views that is hidden, and the error of the second motion, eq. (36a). The differences of consecutive frames have
        the same sign.
        """
        second = motion.ambiguous
        if second is None:
            return changed(self, frames=0, after=ids if self.after is None else self.after), None
        frames = self.frames + 1
        first_from_second = motion.cam_from_ref @ se3.inverse(second.cam_from_ref)  # of the newest camera
        apart = np.linalg.norm(se3.log(first_from_second).reshape(2, 3), axis=1)
        apart = np.minimum(apart, std_moved[[0, 3]])
        cov = Cholesky(Cholesky(second.cov_pose).inverse() + np.diag(std_moved**-2.0)).inverse()
        own = se3.adjoint(first_from_second) @ scaled_cholesky(cov)
        ambiguity = np.concatenate([np.diag(np.repeat(apart, 3)), own], axis=1)
        modes = se3.adjoint(se3.inverse(cam_from_ref)) @ ambiguity
        modes[:, :6] *= np.sqrt(2 * frames - 1)  # n frames of one sign: n²
        cov = self.cov + modes @ modes.T
        motions = (*self.motions, AmbiguousMotion(ids, cov))
        if len(motions) > _MOST:  # memory is bounded: the oldest one can no longer be confirmed
            motions = (AmbiguousMotion(ids[:0], motions[1].cov), *motions[2:])
        return changed(self, cov=cov, frames=frames, motions=motions, after=None), ambiguity

    def settled(self, ids: NDArray[np.int64]) -> tuple["AmbiguousMotions", int]:
        """Return the same after tracks `ids` (n,) have proved to be the scene's, and how many motions this confirms.

        A motion is confirmed if most of its tracks, and many, agreed in the first frame after the ambiguity, and so are
        all after it; none is if few of these tracks are left. The uncertainty of the path before them stays.
        """
        after, first = ids if self.after is None else self.after, len(self.motions)
        if np.count_nonzero(core.among(after, ids)) >= MANY_VIEWS:
            while first and _confirm(after, self.motions[first - 1].ids):
                first -= 1
        left = self.cov_left + (self.motions[first - 1].cov if first else 0)
        return AmbiguousMotions(cov_slides=self.cov_slides, cov_left=left), len(self.motions) - first

    def of_newest(self, cam_from_ref: Array) -> Array:
        """Return its contribution to the covariance (6, 6) of the newest pose, that of a camera (4, 4)."""
        ad = se3.adjoint(cam_from_ref)
        return np.asarray(ad @ (self.cov + self.cov_slides + self.cov_left) @ ad.T)


def _confirm(after: NDArray[np.int64], ids: NDArray[np.int64]) -> bool:
    """Whether many of the tracks `ids` (n,) of a motion, and most of them, are among those `after` (m,) it."""
    agree = np.count_nonzero(core.among(ids, after))
    return bool(agree >= max(MANY_VIEWS, _MOST_TRACKS * len(ids)))
