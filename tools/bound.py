"""The causal bound of poses: least squares over all views so far, with the true covariance of their errors.

No causal estimator has smaller errors. Along a track a view has white noise, a slide that both sides share and that
grows as a random walk from the first view, and a constant of the right side alone. Each track is whitened by a root of
its whole covariance: the root of the covariance of its first views is a part of it, so that the same whitened rows
serve for the estimate of each frame. Linearised at the truth, with the first camera fixed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array
from stream_sfm.geometry.stereo import StereoProjection


@dataclass(slots=True)
class TrackViews:
    """The views of a track: `in_world` (3,), `frames`, `errors_px` (4,) each, the variance of each slide, `std_px`."""

    in_world: Array
    std_px: float
    frames: list[int] = field(default_factory=list)
    errors_px: list[Array] = field(default_factory=list)
    var_slides_px2: list[float] = field(default_factory=list)

    def cov_px2(self, std_constant_px: float) -> Array:
        """Covariance (2n, 2n) of one coordinate of the views: left, right of the first, left, right of the second …"""
        walked = np.repeat(np.cumsum(self.var_slides_px2), 2)
        right = np.tile([0.0, 1.0], len(self.frames))
        white = self.std_px**2 * np.eye(len(walked))
        return white + np.minimum.outer(walked, walked) + std_constant_px**2 * np.outer(right, right)


def causal_errors(
    projection: StereoProjection, true: Array, tracks: Sequence[TrackViews], std_constant_px: float
) -> Array:
    """Return the errors (n, 6), right perturbations, of the estimate of each frame's pose from all views so far."""
    whitened = [_whitened(projection, true, track, std_constant_px) for track in tracks]
    size, result = 6 * len(true), np.zeros((len(true), 6))
    ended, ended_right = np.zeros((size, size)), np.zeros(size)
    for n in range(1, len(true)):
        information, right = ended.copy(), ended_right.copy()
        for track, rows in zip(tracks, whitened, strict=True):
            if track.frames[0] >= n or track.frames[-1] < n - 1:
                continue  # one view says nothing yet; or it is among those that have ended
            part, own, at = _without_point(rows, sum(f <= n for f in track.frames), track.frames)
            information[np.ix_(at, at)] += part
            right[at] += own
            if track.frames[-1] == n - 1:
                ended[np.ix_(at, at)] += part
                ended_right[at] += own
        known = slice(6, 6 * n + 6)
        found = np.linalg.solve(information[known, known] + 1e-9 * np.eye(6 * n), right[known])
        result[n] = found[-6:]
    return result


def _whitened(
    projection: StereoProjection, true: Array, track: TrackViews, std_constant_px: float
) -> tuple[Array, Array, Array]:
    """Return the whitened rows (4n, …) of a track: by the poses of its frames, by its point, and its errors."""
    n = len(track.frames)
    by_pose, by_point = np.zeros((n, 4, 6 * n)), np.zeros((n, 4, 3))
    for k, frame in enumerate(track.frames):
        in_cam = se3.transform(se3.inverse(true[frame]), track.in_world[None])
        a = projection.jacobian(in_cam)[0]
        by_point[k] = a @ true[frame][:3, :3].T
        by_pose[k, :, 6 * k : 6 * k + 6] = a @ se3.point_in_source_jacobian(in_cam)[0]
    root = np.linalg.cholesky(track.cov_px2(std_constant_px))
    rows = np.concatenate([by_pose, by_point, np.array(track.errors_px)[..., None]], axis=2)
    # (left, right) of one coordinate of all views; afterwards both coordinates of a view stand together again
    halves = [np.linalg.solve(root, rows[:, c::2].reshape(2 * n, -1)).reshape(n, 2, -1) for c in range(2)]
    found = np.concatenate(halves, axis=1).reshape(4 * n, -1)
    return found[:, : 6 * n], found[:, 6 * n : -1], found[:, -1]


def _without_point(rows: tuple[Array, Array, Array], views: int, frames: list[int]) -> tuple[Array, Array, np.ndarray]:
    """Return information and right-hand side of the poses by the first views, without the point, and their places."""
    by_pose, by_point, errors = (part[: 4 * views] for part in rows)
    by_pose = by_pose[:, : 6 * views]
    gain = np.linalg.solve(by_point.T @ by_point, by_point.T)
    at = (6 * np.array(frames[:views])[:, None] + np.arange(6)).ravel()
    left = by_pose - by_point @ (gain @ by_pose)
    return left.T @ by_pose, left.T @ errors, at
