"""Motions between two frames, with own errors and errors common to all motions of a run, eq. (74a).

Also the paths made of them: chains of independent motions for fusion, and odometry, which is continuous where the
pose in the world may be corrected.
"""

import logging
from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterable
from dataclasses import field

import numpy as np

from .errors import ConfigError
from .geometry import Array, se3
from .geometry.linear import symmetric
from .record import Kind, changed, record, with_changes
from .types import CommonErrors, FrameEstimate, RelativeMotions, Status

# The first common errors, of lengths and axes: no view shows them, and no change of the rig ends them.
UNSEEN = 3


@record
class Motion:
    """The motion from the frame of an estimate to an earlier one, to be fused or added up.

    `earlier_from_newest` (4, 4): where it is with common errors c = `mean` (m,). truth = earlier_from_newest·
    Exp(`common_jacobian` (c − mean) + own), with own ~ N(0, `cov_own` (6, 6)) and c as known, N(`mean`, `cov_common`).
    m is 0 if nothing is known to be common. It leads from frame `earlier` to frame `newest`; None if they were not
    given. `common_since`: the frame from which these common errors have been those of the rig. `predicted`: no view
    shows it; it is extrapolated from the previous motion, with a matching covariance.
    """

    earlier_from_newest: Array
    cov_own: Array
    common_jacobian: Array = field(default_factory=lambda: np.zeros((6, 0)))
    mean: Array = field(default_factory=lambda: np.zeros(0))
    cov_common: Array = field(default_factory=lambda: np.zeros((0, 0)))
    earlier: int | None = None
    newest: int | None = None
    common_since: int = 0
    predicted: bool = False

    @classmethod
    def of(cls, estimate: FrameEstimate, frames: int = 1) -> "Motion | None":
        """Return the motion since `frames` frames ago; None if there is none, as in the first frame."""
        if estimate.status == Status.LOST:
            return None
        index = estimate.frame_index
        return cls.to_frame(index - frames, estimate.relative, estimate.common, newest=index)

    @classmethod
    def to_frame(
        cls,
        frame_index: int,
        relative: RelativeMotions | None,
        common: CommonErrors | None,
        newest: int | None = None,
    ) -> "Motion | None":
        """Return the motion from the frame `newest` to that of an index; None if there is none."""
        if relative is None or frame_index not in relative.frame_indices:
            return None
        row = int(np.flatnonzero(relative.frame_indices == frame_index)[0])
        pose, cov = relative.frame_from_newest[row], relative.cov[row]
        if common is None or relative.common_jacobian is None:
            return cls(pose, cov, earlier=frame_index, newest=newest)
        j, ends = relative.common_jacobian[row], (frame_index, newest, common.since)
        return cls(pose, cov - j @ common.cov @ j.T, j, common.mean, common.cov, *ends)

    @classmethod
    def predicted_between(cls, before: FrameEstimate, after: FrameEstimate) -> "Motion":
        """Return the motion between the poses of two estimates; its covariance is the growth of the pose's.

        The engine predicts this motion after tracking was lost and a new map began; it has no common errors.
        """
        moved = se3.orthonormalise(se3.inverse(before.world_from_cam) @ after.world_from_cam)
        ad = se3.adjoint(se3.inverse(moved))
        values, vectors = np.linalg.eigh(symmetric(after.cov_pose - ad @ before.cov_pose @ ad.T))
        cov = symmetric(vectors * np.maximum(values, 0) @ vectors.T)
        return cls(moved, cov, earlier=before.frame_index, newest=after.frame_index, predicted=True)

    def then(self, later: "Motion") -> "Motion":
        """Return the motion over this one and a `later` one, which begins where this one ends, eq. (74b).

        Raises ConfigError if it begins at another frame. If the rig has changed between them, the errors of the
        former rig end there.
        """
        if None not in (self.newest, later.earlier) and self.newest != later.earlier:
            raise ConfigError(
                f"a motion ends at frame {self.newest}, and the next one begins at frame {later.earlier}: what lies "
                "between them is missing, such as lost frames; sfm.chain finds motions without gaps"
            )
        known = later if len(later.mean) else self
        is_former = len(self.mean) and len(later.mean) and self.common_since != later.common_since
        first = (self.of_former_rig() if is_former else self).given(known.mean, known.cov_common)
        then = later if known is later else later.given(known.mean, known.cov_common)
        ad = se3.adjoint(se3.inverse(then.earlier_from_newest))
        return Motion(
            se3.orthonormalise(first.earlier_from_newest @ then.earlier_from_newest),
            symmetric(ad @ first.cov_own @ ad.T + then.cov_own),
            ad @ first.common_jacobian + then.common_jacobian,
            known.mean,
            known.cov_common,
            self.earlier,
            later.newest,
            known.common_since,
            self.predicted or later.predicted,
        )

    def of_former_rig(self) -> "Motion":
        """Return the same motion after the rig has changed: only the errors that no view shows remain common."""
        rig = slice(UNSEEN, None)
        by_rig, j = self.common_jacobian[:, rig], self.common_jacobian.copy()
        j[:, rig] = 0
        own = symmetric(self.cov_own + by_rig @ self.cov_common[rig, rig] @ by_rig.T)
        return changed(self, cov_own=own, common_jacobian=j)

    def given(self, mean: Array, cov_common: Array) -> "Motion":
        """Return the same motion, given the current estimate of the common errors, (m,) and (m, m)."""
        j = self.common_jacobian if len(self.mean) else np.zeros((6, len(mean)))
        moved = self.earlier_from_newest
        if len(self.mean):
            moved = se3.orthonormalise(moved @ se3.exp(j @ (mean - self.mean)))
        return changed(self, earlier_from_newest=moved, common_jacobian=j, mean=mean, cov_common=cov_common)

    def back(self) -> "Motion":
        """Return the inverse motion."""
        ad = se3.adjoint(self.earlier_from_newest)
        return changed(
            self,
            earlier_from_newest=se3.inverse(self.earlier_from_newest),
            cov_own=symmetric(ad @ self.cov_own @ ad.T),
            common_jacobian=-ad @ self.common_jacobian,
            earlier=self.newest,
            newest=self.earlier,
        )

    @property
    def cov(self) -> Array:
        """The whole covariance (6, 6), of the perturbation on the right, translation first."""
        return symmetric(self.cov_own + self.common_jacobian @ self.cov_common @ self.common_jacobian.T)

    def __repr__(self) -> str:
        length = f"{np.linalg.norm(self.earlier_from_newest[:3, 3]):.3g} m"
        frames = "" if self.newest is None else f" from frame {self.earlier} to {self.newest}"
        return f"<Motion of {length}{frames}{', predicted' * self.predicted}>"


def chain(estimates: Iterable[FrameEstimate], to: Collection[int] = ()) -> list[Motion]:
    """Return consecutive motions from the first to the last of the estimates, which share only their end frames.

    They are as few as possible, and end at each of the frames `to` that a motion reaches: those at which another
    sensor measures, for example. They cross a loss wherever the window does. Otherwise the motion is `predicted`, and
    the logger `stream_sfm` warns: its covariance allows for what the camera may have done in the meantime.
    `functools.reduce(Motion.then, motions)` combines them into the motion over the whole run. Raises ConfigError
    if no estimate has a motion, as with one camera, whose lengths have no scale.
    """
    frames = {estimate.frame_index: estimate for estimate in estimates}
    if len(frames) > 1 and all(e.relative is None or e.unscaled for e in frames.values()):
        raise ConfigError(
            f"none of {len(frames)} estimates has a motion to an earlier frame with a known scale: all of them are "
            "lost, or they are of one camera, or of a method without covariances of motions"
        )
    came_from, steps, index = _ways(frames, sorted(to)), list[tuple[int, int]](), next(reversed(frames), None)
    while index is not None and (earlier := came_from[index]) is not None:
        steps.append((earlier, index))
        index = earlier
    motions = [_motion(frames[earlier], frames[newest]) for earlier, newest in reversed(steps)]
    for motion in motions:
        if motion.predicted:
            logging.getLogger("stream_sfm").warning(
                f"no view connects frame {motion.earlier} with frame {motion.newest} or a later one: the motion "
                f"between them is predicted, with a σ of {np.sqrt(np.trace(motion.cov[:3, :3])):.2g} m"
            )
    return motions


def _ways(frames: dict[int, FrameEstimate], wanted: list[int]) -> dict[int, int | None]:
    """Return the earlier frame from which the best way to each frame comes; None for the first.

    The best way has the fewest predictions, then misses the fewest `wanted` frames, then has the fewest motions.
    """
    costs: dict[int, tuple[int, int, int]] = {}
    came_from: dict[int, int | None] = {}
    last = None  # a frame that was not lost, or is wanted: predictions start there
    for index, estimate in frames.items():
        seen = [] if estimate.relative is None else estimate.relative.frame_indices.tolist()
        known = [] if estimate.status == Status.LOST else [earlier for earlier in seen if earlier in costs]
        best = None
        for earlier in known or ([] if last is None else [last]):
            missed = bisect_left(wanted, index) - bisect_right(wanted, earlier)
            predictions, others, motions = costs[earlier]
            cost = predictions + (not known), others + missed, motions + 1
            best = min(best or (cost, earlier), (cost, earlier))
        costs[index], came_from[index] = best or ((0, 0, 0), None)
        if last is None or estimate.status != Status.LOST or index in wanted:
            last = index
    return came_from


def _motion(earlier: FrameEstimate, newest: FrameEstimate) -> Motion:
    """Return the motion between two frames, predicted if none was estimated."""
    known = Motion.of(newest, newest.frame_index - earlier.frame_index)
    return Motion.predicted_between(earlier, newest) if known is None else known


def in_world(estimate: FrameEstimate, world_from_map: Array, cov: Array | None = None) -> FrameEstimate:
    """Return an estimate in the world of a map, moved to the world where that map is at `world_from_map` (4, 4).

    `cov` (6, 6): of the perturbation on the right of world_from_map; None if it is exact.
    """
    r = world_from_map[:3, :3]
    cov = np.zeros((6, 6)) if cov is None else cov

    def cov_pose(own: Array, world_from_cam: Array) -> Array:
        to_cam = se3.adjoint(se3.inverse(world_from_cam))
        return np.asarray(own + to_cam @ cov @ to_cam.T)

    def cov_points(own: Array, points: Array) -> Array:
        j = se3.point_in_source_jacobian(points)
        return np.asarray(r @ (own + j @ cov @ np.swapaxes(j, 1, 2)) @ r.T)

    return with_changes(
        estimate,
        {
            Kind.POSES: lambda poses, _: se3.orthonormalise(world_from_map @ poses),
            Kind.COV_POSE: cov_pose,
            Kind.POINTS: lambda points, _: se3.transform(world_from_map, points),
            Kind.COV_POINTS: cov_points,
        },
    )


@record
class Odometry:
    """The path as the chain of motions from each frame to the next, and the velocity (REP 105, eq. (74c)).

    `odom_from_cam` (4, 4) is continuous. Later corrections of earlier motions, by views or by the calibration, are
    in `world_from_odom` (4, 4) alone; `world_from_cam` is the product of both. `cov` (6, 6): of the perturbation on
    the right of odom_from_cam, translation first. `from_previous` (4, 4): the motion since the previous frame,
    `seconds` ago; it carries points of the newest camera into the previous one. `twist` (6,): linear and angular
    velocity in axes of the camera, m/s and rad/s, the mean since the previous frame, with `cov_twist` (6, 6); both
    are None if no motion was estimated: in the first frame of a map, in lost frames, and with a method without
    covariances of motions. odom_from_cam then continues as world_from_cam does.
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
        """Return the odometry of a frame from that of the previous frame, which is None for the first one."""
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
        """Return what later estimates have corrected since the motions were added up, (4, 4)."""
        return se3.orthonormalise(self.estimate.world_from_cam @ se3.inverse(self.odom_from_cam))

    def __repr__(self) -> str:
        return f"<Odometry of frame {self.estimate.frame_index}>"
