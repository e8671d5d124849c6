"""Errors of a trajectory at surveyed test points: in the world, in the image, and of the distances between the points.

In the world (WC): a point seen by both cameras is triangulated and carried by the estimated pose; it contains the
drift of the pose. In the image: the surveyed point, carried into the camera by the estimated pose and projected,
against where it is seen; one camera is enough. Distances (CC): between points that one frame sees with both cameras,
whatever its pose, so that only the local structure shows. Everything here is in axes of the rectified camera.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera.axes import RectifiedAxes
from ..camera.unseen_errors import UnseenErrors
from ..errors import ConfigError
from ..geometry import se3
from ..geometry.linear import mahalanobis2, matvec
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection, clamp_depth
from ..types import Trajectory
from .association import NEAREST_NS, matched
from .drift import distances_m
from .survey_tie import Tie, tie_by_points, tie_frame
from .surveyed_points import NO_FRAME, SurveyedPoints


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SurveyViews:
    """The sightings as views `z_px` (n, 4) of the rectified cameras, the right side NaN where there is none.

    `shared_px` (n, 4, m): what the m errors of the calibration, each of σ 1, do to them all. `rect_from_cam` (3, 3):
    axes of the rectified left camera from those of the physical one.
    """

    points: SurveyedPoints
    z_px: Array
    shared_px: Array
    projection: StereoProjection
    rect_from_cam: Array
    unseen: UnseenErrors


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SurveyErrors:
    """Errors of r sightings, with their σ where the covariance of the poses is known there; NaN otherwise.

    `error_m` (r, 3), along the axes of the world, with `sigma_m`, the square root of its covariance's trace, and
    `nees` (3 is expected); `error_px` (r, 2) in the left image with `sigma_px` and `nees_px` (2 is expected);
    `travelled_m` (r,). Of q pairs of points in one frame: `pair_frames`, `pair_error_m`, `pair_sigma_m`. `absent`
    sightings are in no frame of the run; `tied_to`: the frame that ties the survey's axes to the run, not compared.
    """

    names: tuple[str, ...]
    frames: NDArray[np.int64]
    travelled_m: Array
    error_m: Array
    sigma_m: Array
    nees: Array
    error_px: Array
    sigma_px: Array
    nees_px: Array
    pair_frames: NDArray[np.int64]
    pair_error_m: Array
    pair_sigma_m: Array
    absent: int
    tied_to: int | None

    def figures(self) -> dict[str, Any]:
        """`test_points` of summary.json; docs/formats.md explains each key."""
        both = np.isfinite(self.error_m).all(axis=1)
        last = both & (self.frames == max(self.frames[both], default=NO_FRAME))
        last_m = _rms(np.linalg.norm(self.error_m[last], axis=1))
        travelled_m = float(self.travelled_m[last].max()) if last.any() else 0.0
        return {
            "sightings": len(self.frames),
            "absent": self.absent,
            "tied_to_frame": self.tied_to,
            "position_rms_m": _rms(np.linalg.norm(self.error_m[both], axis=1)),
            "position_error_over_sigma": _over_sigma(self.nees, 3),
            "last_frame": int(self.frames[last].max()) if last.any() else None,
            "last_position_rms_m": last_m,
            "last_position_percent": None if last_m is None or not travelled_m else 100 * last_m / travelled_m,
            "image_rms_px": _rms(np.linalg.norm(self.error_px, axis=1)),
            "image_error_over_sigma": _over_sigma(self.nees_px, 2),
            "distance_rms_m": _rms(self.pair_error_m),
            "distance_error_over_sigma": _rms(self.pair_error_m / self.pair_sigma_m),
        }

    def warnings(self) -> list[str]:
        """What to tell about sightings that were not compared."""
        if not self.absent:
            return []
        count = f"{self.absent} sighting{' is' if self.absent == 1 else 's are'}"
        return [
            f"test points: {count} in no frame of the run: frames count from 0, stamps are those of left images"
        ]

    def to_summary(self) -> dict[str, Any]:
        """`test_points` of summary.json: figures, RMS errors by frame, and each sighting; None where not known."""
        return self.figures() | {"by_frame": self.by_frame(), "seen": self._rows()}

    def by_frame(self) -> list[dict[str, Any]]:
        """RMS errors of the points in each frame, with the RMS of their σ."""
        rows = []
        for frame in np.unique(self.frames):
            here, pairs = self.frames == frame, self.pair_frames == frame
            rows.append(
                {
                    "frame": int(frame),
                    "travelled_m": float(self.travelled_m[here][0]),
                    "position_rms_m": _rms(np.linalg.norm(self.error_m[here], axis=1)),
                    "position_sigma_m": _rms(self.sigma_m[here]),
                    "image_rms_px": _rms(np.linalg.norm(self.error_px[here], axis=1)),
                    "image_sigma_px": _rms(self.sigma_px[here]),
                    "distance_rms_m": _rms(self.pair_error_m[pairs]),
                    "distance_sigma_m": _rms(self.pair_sigma_m[pairs]),
                }
            )
        return rows

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {
                "point": self.names[k],
                "frame": int(self.frames[k]),
                "travelled_m": float(self.travelled_m[k]),
                "error_m": _known(self.error_m[k]),
                "sigma_m": _known(self.sigma_m[k]),
                "error_px": _known(self.error_px[k]),
                "sigma_px": _known(self.sigma_px[k]),
            }
            for k in range(len(self.frames))
        ]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class _Sightings:
    """Sightings that are in the run: views, effects of the calibration, rows of the points, frames."""

    z_px: Array
    shared_px: Array
    point_rows: NDArray[np.int64]
    frames: NDArray[np.int64]

    def of(self, rows: NDArray[np.bool_]) -> "_Sightings":
        """Some of them."""
        return _Sightings(self.z_px[rows], self.shared_px[rows], self.point_rows[rows], self.frames[rows])


def survey_errors(views: SurveyViews, estimate: Trajectory, truth: Trajectory | None) -> SurveyErrors:
    """Compare a trajectory with the points. `truth` is needed where the points are in its world.

    Raises ConfigError where the points cannot be brought into the world of the run.
    """
    survey = views.points
    frames = _frames(survey, estimate.stamps_ns)
    inside = frames != NO_FRAME
    if not inside.any():
        raise ConfigError(
            f"test points: none of the {len(frames)} sightings is in a frame of the run: frames count from 0, stamp_ns "
            "is that of the left image"
        )
    seen = _Sightings(views.z_px, views.shared_px, survey.point_rows, frames).of(inside)
    axes = RectifiedAxes(views.rect_from_cam.T)  # from physical axes to rectified ones
    poses, cov = axes.poses(estimate.world_from_cam), _covariances(axes, estimate)
    tie = _tie(views, seen, estimate, truth, poses)
    seen = seen.of(seen.frames != (NO_FRAME if tie.frame is None else tie.frame))
    true = se3.transform(tie.world_from_survey, survey.positions_m[seen.point_rows])
    surveyed = true, tie.cov_of_points(true, survey.std_m)
    at = poses[seen.frames], cov[seen.frames]
    local = _triangulated(views, seen)
    error_m, sigma_m, nees = _in_world(views, at, local, surveyed)
    return SurveyErrors(
        tuple(survey.names[row] for row in seen.point_rows),
        seen.frames,
        distances_m(estimate.world_from_cam)[seen.frames],
        error_m @ views.rect_from_cam,
        sigma_m,
        nees,
        *_in_image(views, seen, at, surveyed),
        *_distances(views, seen, local),
        int((~inside).sum()),
        tie.frame,
    )


def _frames(points: SurveyedPoints, stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """The frame (n,) of the run that each sighting is in, or -1; a stamp is right within a millisecond."""
    frames = np.where(points.frames < len(stamps_ns), points.frames, NO_FRAME)
    by_stamp = points.frames == NO_FRAME
    if len(stamps_ns) and by_stamp.any():
        wanted = points.stamps_ns[by_stamp]
        nearest = np.abs(stamps_ns[None] - wanted[:, None]).argmin(axis=1)
        frames[by_stamp] = np.where(np.abs(stamps_ns[nearest] - wanted) <= NEAREST_NS, nearest, NO_FRAME)
    return np.asarray(frames, np.int64)


def _covariances(axes: RectifiedAxes, estimate: Trajectory) -> Array:
    """Covariances (n, 6, 6) of the poses in rectified axes, NaN where there are none."""
    if estimate.cov_pose is None:
        return np.full((len(estimate), 6, 6), np.nan)
    return np.array([axes.cov_pose(c) for c in estimate.cov_pose]).reshape(-1, 6, 6)


def _tie(views: SurveyViews, seen: _Sightings, estimate: Trajectory, truth: Trajectory | None, poses: Array) -> Tie:
    """What brings the surveyed coordinates into the world of the run."""
    survey, rect_from_cam = views.points, se3.from_rotation_translation(views.rect_from_cam, np.zeros(3))
    known, unknown = np.zeros((6, 6)), np.full((6, 6), np.nan)
    if survey.world == "first camera":
        return Tie(rect_from_cam, known)
    if survey.world == "ground truth":
        rows, true = matched(estimate, truth) if truth is not None else (np.empty(0, np.int64), estimate)
        if not len(rows):
            raise ConfigError(
                "test points: their coordinates are those of the ground truth, and no frame of the run has any: give "
                'one, or another world in the file, such as world = "survey"'
            )
        world_from_truth = estimate.world_from_cam[rows[0]] @ se3.inverse(true.world_from_cam[0])
        return Tie(rect_from_cam @ world_from_truth, known if rows[0] == 0 else unknown)
    positions = survey.positions_m
    frame = tie_frame(seen.frames, seen.point_rows, seen.z_px, positions)
    there = seen.of(seen.frames == frame)
    cam_from_survey, cov = tie_by_points(
        views.projection, there.z_px, positions[there.point_rows], survey.std_px, survey.std_m
    )
    # the first camera is the world; the pose of a later one is uncertain together with all that follow
    return Tie(poses[frame] @ cam_from_survey, cov if frame == 0 else unknown, frame)


_Local = tuple[Array, Array, Array]  # points (n, 3), and what noise (n, 3, 4) and calibration (n, 3, m) do to them


def _triangulated(views: SurveyViews, seen: _Sightings) -> _Local:
    """Points in the camera by least squares over both sides, NaN for those that one side sees."""
    n, m = len(seen.z_px), seen.shared_px.shape[2]
    points, noise, shared = np.full((n, 3), np.nan), np.full((n, 3, 4), np.nan), np.full((n, 3, m), np.nan)
    both = np.isfinite(seen.z_px).all(axis=1)
    z = seen.z_px[both]
    rough = views.projection.triangulate(z)
    a = views.projection.jacobian(rough)
    gain: Array = np.asarray(np.linalg.pinv(a), np.float64)
    points[both] = rough + matvec(gain, z - views.projection.project(rough))
    noise[both], shared[both] = views.points.std_px * gain, gain @ seen.shared_px[both]
    return points, noise, shared


def _in_world(
    views: SurveyViews, at: tuple[Array, Array], local: _Local, surveyed: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Errors (n, 3) of points carried into the world, their σ (n,) and NEES (n,)."""
    (poses, cov), (points, noise, shared), (true, cov_true) = at, local, surveyed
    rotation = poses[:, :3, :3]
    carried = _carried(poses, points)
    j = -se3.point_in_source_jacobian(points)
    # a wrong baseline moves pose and point alike: it counts once, for where the point is in the world
    own = cov - views.unseen.of_pose(poses)
    in_cam = _squared(noise) + _squared(shared) + j @ own @ np.swapaxes(j, 1, 2)
    total = rotation @ in_cam @ np.swapaxes(rotation, 1, 2) + views.unseen.of_points(carried) + cov_true
    error = carried - true
    return error, np.sqrt(np.trace(total, axis1=1, axis2=2)), _nees(error, total)


def _in_image(
    views: SurveyViews, seen: _Sightings, at: tuple[Array, Array], surveyed: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Errors (n, 2) in the left image, their σ (n,) and NEES (n,)."""
    (poses, cov), (true, cov_true) = at, surveyed
    rotation = poses[:, :3, :3]
    points = clamp_depth(_carried(se3.inverse(poses), true))
    a = views.projection.jacobian(points)[:, :2]
    j = se3.point_in_source_jacobian(points)
    in_cam = j @ cov @ np.swapaxes(j, 1, 2) + np.swapaxes(rotation, 1, 2) @ cov_true @ rotation
    total = a @ in_cam @ np.swapaxes(a, 1, 2) + _squared(seen.shared_px[:, :2])
    total = total + views.points.std_px**2 * np.eye(2)
    error = seen.z_px[:, :2] - views.projection.project(points)[:, :2]
    return error, np.sqrt(np.trace(total, axis1=1, axis2=2)), _nees(error, total)


def _distances(views: SurveyViews, seen: _Sightings, local: _Local) -> tuple[NDArray[np.int64], Array, Array]:
    """Frames (q,), errors and σ of the distances between all pairs of points that one frame sees with both cameras."""
    points, noise, shared = local
    both = np.flatnonzero(np.isfinite(points).all(axis=1))
    pairs = [
        (i, k)
        for frame in np.unique(seen.frames[both])
        for i, k in combinations(both[seen.frames[both] == frame].tolist(), 2)
        if seen.point_rows[i] != seen.point_rows[k]
    ]
    i, k = np.array(pairs, np.int64).reshape(-1, 2).T
    apart = points[k] - points[i]
    distance = np.linalg.norm(apart, axis=1)
    along = apart / np.maximum(distance, 1e-12)[:, None]
    survey = views.points.positions_m[seen.point_rows]
    cov = _squared(noise[i]) + _squared(noise[k]) + _squared(shared[k] - shared[i]) + views.unseen.of_points(apart)
    variance = np.einsum("qa,qab,qb->q", along, cov, along) + 2 * views.points.std_m**2
    return seen.frames[i], distance - np.linalg.norm(survey[k] - survey[i], axis=1), np.sqrt(variance)


def _carried(poses: Array, points: Array) -> Array:
    """Points (n, 3), each by its own pose (n, 4, 4)."""
    return matvec(poses[:, :3, :3], points) + poses[:, :3, 3]


def _squared(factors: Array) -> Array:
    """F Fᵀ of factors (n, a, b)."""
    return factors @ np.swapaxes(factors, 1, 2)


def _nees(errors: Array, cov: Array) -> Array:
    """eᵀ Σ⁻¹ e (n,), NaN where either is not known."""
    result = np.full(len(errors), np.nan)
    known = np.isfinite(errors).all(axis=1) & np.isfinite(cov).all(axis=(1, 2))
    result[known] = mahalanobis2(errors[known], cov[known])
    return result


def _rms(values: Array) -> float | None:
    """Root mean square of those that are known; None where none is."""
    known = values[np.isfinite(values)]
    return float(np.sqrt((known**2).mean())) if len(known) else None


def _over_sigma(nees: Array, dof: int) -> float | None:
    """Errors in units of their σ, root mean square: 1 where they are consistent."""
    known = nees[np.isfinite(nees)]
    return float(np.sqrt(known.mean() / dof)) if len(known) else None


def _known(value: Any) -> Any:
    """A number or a list of numbers for JSON; None where it is not known."""
    return np.asarray(value).tolist() if np.isfinite(value).all() else None
