"""Errors of a trajectory: absolute (ATE), at its end, over segments, of its scale, and in units of its covariances.

Arguments are poses world_from_cam (n, 4, 4) with equal stamps row by row; lengths are metres.
"""

from typing import NamedTuple

import numpy as np

from ..geometry import Array, se3
from ..geometry.linear import scaled_cholesky
from .settings import SETTINGS


def from_first_camera(world_from_cam: Array) -> Array:
    """Express poses in the axes of their first camera; two such trajectories have aligned first poses."""
    return se3.inverse(world_from_cam[0]) @ world_from_cam


def umeyama(target: Array, source: Array, with_scale: bool = False) -> tuple[float, Array]:
    """Find the scale s and rigid motion (4, 4) that minimise Σ‖target − (s·R·source + t)‖² over points (n, 3), n ≥ 1.

    S. Umeyama, PAMI 1991, eqs. 40–42; s = 1 without `with_scale`. Where the points do not determine the rotation
    (on a line, or all in one place), one of the minimisers is returned; all have the same residual. The scale of a
    source without extent is NaN.
    """
    mean_t, mean_s = target.mean(axis=0), source.mean(axis=0)
    t0, s0 = target - mean_t, source - mean_s
    u, d, vt = np.linalg.svd(t0.T @ s0 / len(target))
    sign = np.array([1, 1, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = u @ np.diag(sign) @ vt
    scale = 1.0
    if with_scale:
        variance = float((s0**2).sum() / len(source))
        scale = float((d * sign).sum() / variance) if variance > 0 else float("nan")
    return scale, se3.from_rotation_translation(rotation, mean_t - scale * rotation @ mean_s)


def ate_rmse_m(estimate: Array, truth: Array) -> float:
    """Return the RMS position error with only the first poses aligned, eq. (53)."""
    return _rms(from_first_camera(estimate)[:, :3, 3] - from_first_camera(truth)[:, :3, 3])


def ate_axes_m(estimate: Array, truth: Array) -> Array:
    """Return the components (3,) of `ate_rmse_m` along right, down and forwards of the first camera."""
    apart = from_first_camera(estimate)[:, :3, 3] - from_first_camera(truth)[:, :3, 3]
    return np.asarray(np.sqrt((apart**2).mean(axis=0)))


def ate_rmse_aligned_m(estimate: Array, truth: Array) -> float:
    """Return the RMS position error after the best rigid alignment: SE(3), without scale (Umeyama 1991)."""
    _, truth_from_estimate = umeyama(truth[:, :3, 3], estimate[:, :3, 3])
    return _rms(se3.transform(truth_from_estimate, estimate[:, :3, 3]) - truth[:, :3, 3])


def ate_rmse_sim3_m(estimate: Array, truth: Array) -> tuple[float, float]:
    """Return the RMS position error after the best similarity, eq. (67), and metres per unit of the estimate.

    This is for a single camera only, which does not determine the scale.
    """
    scale, truth_from_estimate = umeyama(truth[:, :3, 3], estimate[:, :3, 3], with_scale=True)
    return _rms(se3.transform(truth_from_estimate, scale * estimate[:, :3, 3]) - truth[:, :3, 3]), scale


def _rms(differences: Array) -> float:
    return float(np.sqrt((differences**2).sum(axis=-1).mean()))


def nees_pose(estimate: Array, cov_pose: Array, truth: Array, std_truth: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Return the NEES (n,) of poses: ξᵀ Σ⁻¹ ξ with truth = estimate·Exp(ξ), eq. (59); 6 is expected.

    Both trajectories are expressed in the axes of their first camera. `cov_pose` (n, 6, 6) belongs to the right
    perturbation relative to the first camera, translation first; `std_truth`: σ of each pose of the truth itself, m
    and rad, of which the first one enters as well. NaN where the covariance is zero (the first frame,
    exact by definition) or not finite; infinite where it is not positive definite.
    """
    true = from_first_camera(truth)
    xi = se3.log(se3.inverse(from_first_camera(estimate)) @ true)
    of_pose, of_first = np.diag(np.repeat(np.square(std_truth), 3)), se3.adjoint(se3.inverse(true))
    cov = cov_pose + of_pose + of_first @ of_pose @ of_first.swapaxes(-1, -2)
    result = np.full(len(xi), np.nan)
    for i in np.flatnonzero(np.isfinite(cov_pose).all(axis=(1, 2)) & cov_pose.any(axis=(1, 2))):
        result[i] = np.inf
        if (np.diag(cov_pose[i]) > 0).all():
            try:
                result[i] = (np.linalg.solve(scaled_cholesky(cov[i]), xi[i]) ** 2).sum()
            except np.linalg.LinAlgError:
                continue
    return result


def mean_of_known(nees: Array) -> float | None:
    """Return the mean of the NEES (n,) that are not NaN, 6 expected; None where none is finite."""
    return float(nees[~np.isnan(nees)].mean()) if np.isfinite(nees).any() else None


def distances_m(world_from_cam: Array) -> Array:
    """Return the distance travelled (n,) up to each pose."""
    steps = np.linalg.norm(np.diff(world_from_cam[:, :3, 3], axis=0), axis=1)
    return np.concatenate([np.zeros(min(1, len(world_from_cam))), np.cumsum(steps)])


def path_length_m(world_from_cam: Array) -> float:
    """Return the length of the path through all positions; shaking and noise add to it."""
    return float(distances_m(world_from_cam)[-1]) if len(world_from_cam) else 0.0


def final_drift_percent(estimate: Array, truth: Array) -> float:
    """Return the end-point error in per cent of the true path, first poses aligned, eq. (54); NaN without motion."""
    length = path_length_m(truth)
    if length < SETTINGS.standing_m:
        return float("nan")
    end_error = from_first_camera(estimate)[-1, :3, 3] - from_first_camera(truth)[-1, :3, 3]
    return 100 * float(np.linalg.norm(end_error)) / length


def scale_error_percent(estimate: Array, truth: Array) -> float:
    """Return by how many per cent the estimate is too large, eq. (58), negative: too small; NaN when standing still.

    1/s − 1 for the similarity scale s that aligns the estimated positions with the true ones (Umeyama 1991, eq. 42).
    The ratio of path lengths would be biased by the noise of each pose.
    """
    e, t = estimate[:, :3, 3], truth[:, :3, 3]
    if len(t) < 2 or np.ptp(t, axis=0).max() < SETTINGS.standing_m or np.ptp(e, axis=0).max() == 0:
        return float("nan")
    return 100 * (1 / umeyama(t, e, with_scale=True)[0] - 1)


class SegmentErrors(NamedTuple):
    """Mean errors over all segments, NaN if there are none; `lengths_m`: those with at least one segment."""

    t_rel_percent: float
    r_rel_deg_per_100m: float
    lengths_m: tuple[float, ...]


def segment_errors(estimate: Array, truth: Array) -> SegmentErrors:
    """Compute KITTI's t_rel and r_rel, eqs. (55) and (56).

    As defined by Geiger, Lenz and Urtasun (CVPR 2012) and their devkit (`evaluate_odometry.cpp`): a segment begins at a
    frame and ends at the first frame *beyond* the length along the true path; its error is inverse(estimated
    motion)·true motion; the means are taken over all segments of all lengths. The devkit begins a segment at every
    tenth frame and uses lengths of 100, 200 … 800 m, and so does this function where the path is at least 200 m long.
    A shorter path is measured over 10, 20 … 100 m, and one below 20 m over 10, 20 … 90 % of its length, with a segment
    from every frame.
    """
    along = distances_m(truth)
    path_m = float(along[-1]) if len(along) else 0.0
    unit_m, most = (100.0, 8) if path_m >= 200 else (10.0, 10) if path_m >= 20 else (path_m / 10, 9)
    starts = np.arange(0, len(along), 10 if path_m >= 200 else 1)
    translation, rotation, used = [], [], []
    for length in (unit_m * k for k in range(1, most + 1)):
        ends = np.searchsorted(along, along[starts] + length, side="right")
        inside = ends < len(along)
        if length <= 0 or not inside.any():
            continue
        a, b = starts[inside], ends[inside]
        motion, true = (se3.inverse(poses[a]) @ poses[b] for poses in (estimate, truth))
        error = se3.inverse(motion) @ true
        translation.append(np.linalg.norm(error[:, :3, 3], axis=1) / length)
        rotation.append(np.linalg.norm(se3.log_so3(error[:, :3, :3]), axis=1) / length)
        used.append(length)
    if not used:
        return SegmentErrors(float("nan"), float("nan"), ())
    t, r = np.concatenate(translation).mean(), np.concatenate(rotation).mean()
    return SegmentErrors(100 * float(t), 100 * float(np.degrees(r)), tuple(used))
