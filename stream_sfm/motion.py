"""Motions between two frames, their errors split into own ones and those common to all motions of a run, eq. (74a).

And the path that they make in a row: odometry, which is continuous, where the pose in the world may be corrected.
"""

from dataclasses import dataclass, field

import numpy as np

from .geometry import se3
from .geometry.linear import symmetric
from .geometry.se3 import Array
from .types import CommonErrors, FrameEstimate, RelativeMotions, Status


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Motion:
    """The motion from the frame of an estimate to an earlier one, to be fused or added up.

    `earlier_from_newest` (4, 4): where it is with common errors c = `mean` (m,). truth = earlier_from_newest·
    Exp(`common_jacobian` (c − mean) + own), with own ~ N(0, `cov_own` (6, 6)) and c as known, N(`mean`, `cov_common`).
    m is 0 where nothing is known to be common.
    """

    earlier_from_newest: Array
    cov_own: Array
    common_jacobian: Array = field(default_factory=lambda: np.zeros((6, 0)))
    mean: Array = field(default_factory=lambda: np.zeros(0))
    cov_common: Array = field(default_factory=lambda: np.zeros((0, 0)))

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
        """Return the motion of a frame to the one with an index; None where there is none."""
        if relative is None or frame_index not in relative.frame_indices:
            return None
        row = int(np.flatnonzero(relative.frame_indices == frame_index)[0])
        pose, cov = relative.frame_from_newest[row], relative.cov[row]
        if common is None or relative.common_jacobian is None:
            return cls(pose, cov)
        j = relative.common_jacobian[row]
        return cls(pose, cov - j @ common.cov @ j.T, j, common.mean, common.cov)

    def then(self, later: "Motion") -> "Motion":
        """Return the motion over this one and a `later` one, which begins where this one ends, eq. (74b)."""
        known = later if len(later.mean) else self
        first, then = self.given(known.mean, known.cov_common), later.given(known.mean, known.cov_common)
        ad = se3.adjoint(se3.inverse(then.earlier_from_newest))
        return Motion(
            se3.orthonormalise(first.earlier_from_newest @ then.earlier_from_newest),
            symmetric(ad @ first.cov_own @ ad.T + then.cov_own),
            ad @ first.common_jacobian + then.common_jacobian,
            known.mean,
            known.cov_common,
        )

    def given(self, mean: Array, cov_common: Array) -> "Motion":
        """Return the same motion with the common errors as they are known by now, (m,) and (m, m)."""
        j = self.common_jacobian if len(self.mean) else np.zeros((6, len(mean)))
        moved = self.earlier_from_newest
        if len(self.mean):
            moved = se3.orthonormalise(moved @ se3.exp(j @ (mean - self.mean)))
        return Motion(moved, self.cov_own, j, mean, cov_common)

    def back(self) -> "Motion":
        """Return the same motion the other way."""
        ad = se3.adjoint(self.earlier_from_newest)
        pose, cov = se3.inverse(self.earlier_from_newest), symmetric(ad @ self.cov_own @ ad.T)
        return Motion(pose, cov, -ad @ self.common_jacobian, self.mean, self.cov_common)

    @property
    def cov(self) -> Array:
        """The whole covariance (6, 6), of the perturbation on the right, translation first."""
        return symmetric(self.cov_own + self.common_jacobian @ self.cov_common @ self.common_jacobian.T)

    def __repr__(self) -> str:
        return f"<Motion of {np.linalg.norm(self.earlier_from_newest[:3, 3]):.3g} m>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Odometry:
    """The path as the chain of motions from each frame to the next, and the velocity (REP 105, eq. (74c)).

    `odom_from_cam` (4, 4) is continuous: what later views or a corrected calibration change of earlier motions is in
    `world_from_odom` (4, 4) alone, and `world_from_cam` is the product of both. `cov` (6, 6): of the perturbation on
    the right of odom_from_cam, translation first. `from_previous` (4, 4): the motion since the previous frame,
    `seconds` ago; it carries points of the newest camera into the previous one. `twist` (6,): linear and angular
    velocity in axes of the camera, m/s and rad/s, the mean since the previous frame, with `cov_twist` (6, 6);
    both are None where no motion was estimated: in the first frame of a map, in lost frames, and of a method
    without covariances of motions. There odom_from_cam goes on as world_from_cam does.
    """

    odom_from_cam: Array
    cov: Array
    estimate: FrameEstimate
    from_previous: Array = field(default_factory=lambda: np.eye(4))
    seconds: float = 0.0
    twist: Array | None = None
    cov_twist: Array | None = None
    by_common: Array = field(default_factory=lambda: np.zeros((6, 0)))

    @classmethod
    def after(cls, before: "Odometry | None", estimate: FrameEstimate) -> "Odometry":
        """Return the odometry of a frame from that of the one before it, which is None for the first one."""
        if before is None:
            return cls(estimate.world_from_cam, estimate.cov_pose, estimate)
        last = before.estimate
        motion = Motion.of(estimate, estimate.frame_index - last.frame_index)
        seconds = (estimate.stamp_ns - last.stamp_ns) / 1e9
        if motion is None:
            moved = se3.orthonormalise(se3.inverse(last.world_from_cam) @ estimate.world_from_cam)
            ad = se3.adjoint(se3.inverse(moved))
            cov = ad @ (before.cov - last.cov_pose) @ ad.T + estimate.cov_pose
            odom_from_cam = se3.orthonormalise(before.odom_from_cam @ moved)
            return cls(odom_from_cam, cov, estimate, moved, seconds, by_common=ad @ before.by_common)
        moved, by_common = motion.earlier_from_newest, before.by_common
        ad = se3.adjoint(se3.inverse(moved))
        if by_common.shape[1] != len(motion.mean):
            by_common = np.zeros((6, len(motion.mean)))
        by_common = ad @ by_common
        shared = by_common @ motion.cov_common @ motion.common_jacobian.T
        cov = symmetric(ad @ before.cov @ ad.T + motion.cov + shared + shared.T)
        xi = se3.log(moved)
        root = se3.log_jacobian(xi) / seconds
        return cls(
            se3.orthonormalise(before.odom_from_cam @ moved),
            cov,
            estimate,
            moved,
            seconds,
            xi / seconds,
            symmetric(root @ motion.cov @ root.T),
            by_common + motion.common_jacobian,
        )

    @property
    def world_from_odom(self) -> Array:
        """What later knowledge has changed since the motions were added up, (4, 4)."""
        return se3.orthonormalise(self.estimate.world_from_cam @ se3.inverse(self.odom_from_cam))

    def __repr__(self) -> str:
        return f"<Odometry of frame {self.estimate.frame_index}>"
