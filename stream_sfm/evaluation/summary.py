"""Figures of a whole run: those against ground truth (the section `ground_truth` of summary.json), and its end."""

from typing import Any

import numpy as np

from ..types import Trajectory
from . import trajectory as metrics
from .association import check_rigid, matched
from .global_structure import GLOBAL_FIGURES
from .relative_consistency import RelativeRecord, against_truth, over_sigma
from .structure import STRUCTURE_FIGURES, StructureComparison

FIGURES = (  # of every run, against ground truth
    "ate_rmse_m", "ate_axes_m", "ate_rmse_aligned_m", "final_drift_percent", "t_rel_percent", "r_rel_deg_per_100m",
    "segment_lengths_m", "scale_error_percent", "nees_pose_mean", *STRUCTURE_FIGURES, *GLOBAL_FIGURES,
    "frames_compared",
)  # fmt: skip


def evaluate(
    estimate: Trajectory,
    truth: Trajectory,
    structure: StructureComparison | None = None,
    std_truth: tuple[float, float] = (0.0, 0.0),
) -> dict[str, Any]:
    """Compute all figures against ground truth; a figure is None if it is not defined.

    That is the case for a short path, a camera that stands still, or a log without depth images. `frames_compared` is
    the number of estimates that have a truth. The NEES is given only if the first frame of the estimate has a
    truth, because covariances are relative to that frame; `std_truth`: σ of the truth itself, m and rad. Raises
    LogError if the truth is not made of rigid motions.
    """
    check_rigid(truth)
    rows, true = matched(estimate, truth)
    e, t = estimate.world_from_cam[rows], true.world_from_cam
    figures: dict[str, Any] = dict.fromkeys(FIGURES) | {"segment_lengths_m": [], "frames_compared": len(rows)}
    if len(rows) >= 2:
        segments = metrics.segment_errors(e, t)
        figures |= {
            "ate_rmse_m": metrics.ate_rmse_m(e, t),
            "ate_axes_m": metrics.ate_axes_m(e, t).tolist(),
            "ate_rmse_aligned_m": metrics.ate_rmse_aligned_m(e, t),
            "final_drift_percent": metrics.final_drift_percent(e, t),
            "t_rel_percent": segments.t_rel_percent,
            "r_rel_deg_per_100m": segments.r_rel_deg_per_100m,
            "segment_lengths_m": [float(length) for length in segments.lengths_m],
            "scale_error_percent": metrics.scale_error_percent(e, t),
        }
        if estimate.cov_pose is not None and rows[0] == 0:
            nees = metrics.nees_pose(e, estimate.cov_pose[rows], t, std_truth)
            figures["nees_pose_mean"] = metrics.mean_of_known(nees)
    if structure is not None:
        figures |= structure.figures() | structure.test_points.figures(estimate, truth)
    return {key: _or_none(value) for key, value in figures.items()}


def evaluate_run(
    estimate: Trajectory,
    relative: RelativeRecord,
    truth: Trajectory,
    std_truth: tuple[float, float],
    structure: StructureComparison | None = None,
) -> dict[str, Any]:
    """Compute the figures of `evaluate`, and the consistency of the covariances of relative motions. Raises as it."""
    spans = against_truth(relative, truth, std_truth)
    return evaluate(estimate, truth, structure, std_truth) | {
        "std_truth": list(std_truth),
        "relative_consistency": spans,
        **over_sigma(spans),
    }


def evaluate_unscaled(estimate: Trajectory, truth: Trajectory) -> dict[str, Any]:
    """Compute the figures of a trajectory from one camera, after an alignment that includes scale.

    `ate_rmse_sim3_m`, and the same in per cent of the true path, `ate_sim3_percent`; `metres_per_unit` is the scale
    of the alignment. They are None if the camera stands still or fewer than two frames have a truth.
    """
    rows, true = matched(estimate, truth)
    e, t = estimate.world_from_cam[rows], true.world_from_cam
    names, path_m = ("ate_rmse_sim3_m", "ate_sim3_percent", "metres_per_unit"), metrics.path_length_m(t)
    figures: dict[str, Any] = dict.fromkeys(names)
    if len(rows) >= 2 and path_m > 0:
        error_m, scale = metrics.ate_rmse_sim3_m(e, t)
        figures = dict(zip(names, (error_m, 100 * error_m / path_m, scale), strict=True))
    figures |= {"true_path_length_m": path_m, "frames_compared": len(rows)}
    return {key: _or_none(value) for key, value in figures.items()}


def _or_none(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value


def end_pose(trajectory: Trajectory) -> dict[str, Any] | None:
    """Return the last position and heading with their σ; None if there is no frame.

    The heading is the direction of the optical axis in the plane of the first camera's x and z, from z towards x.
    """
    if not len(trajectory) or trajectory.cov_pose is None:
        return None
    pose, cov = trajectory.world_from_cam[-1], trajectory.cov_pose[-1]
    length_m = metrics.path_length_m(trajectory.world_from_cam)
    std_m = float(np.sqrt(np.trace(cov[:3, :3])))
    up = pose[:3, :3].T @ (0, 1, 0)  # the axis of a change of heading, in camera axes
    return {
        "position_m": pose[:3, 3].tolist(),
        "std_position_m": std_m,
        "std_position_percent": 100 * std_m / length_m if length_m > 0 else None,
        "heading_deg": float(np.degrees(np.arctan2(pose[0, 2], pose[2, 2]))),
        "std_heading_deg": float(np.degrees(np.sqrt(up @ cov[3:, 3:] @ up))),
    }
