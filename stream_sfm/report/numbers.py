"""The content of report.json: every figure of the page, computed from all frames."""

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..config import config_to_toml
from ..evaluation.association import matched, truth_of_frames
from ..evaluation.relative import (
    enough_known,
    growth_exponents,
    mean_squares,
    paired_ratio,
    relative_errors,
    turning,
)
from ..evaluation.summary import FIGURES, end_pose, evaluate_run
from ..evaluation.trajectory import path_length_m
from ..geometry.se3 import Array
from ..types import Trajectory
from .records import Comparison, RunRecord, quantiles

SCHEMA_VERSION = 1
_AGAINST_TRUTH = (
    *FIGURES, "growth_exponent", "growth_exponent_ci95", "growth_exponent_rotation", "growth_exponent_rotation_ci95",
    "rpe_position_rms_m", "rpe_rotation_rms_deg", "std_truth", "relative_consistency", "straight", "turning",
)  # fmt: skip
_TURN_SPAN = 10  # frames over which the camera counts as straight or turning


def numbers(comparison: Comparison) -> dict[str, Any]:
    """Compute the content of report.json; a figure that is not defined for this log is None."""
    c = comparison
    truth, known = c.truth.poses, [0]
    if truth is not None:
        known += [len(matched(r.trajectory(), truth)[0]) for r in c.runs]
    ratios, away = _over_cross_frame(c), _divergence(c)
    return {
        "schema_version": SCHEMA_VERSION,
        "software_version": __version__,
        "log": c.log,
        "complete": c.complete and not any(r.failure for r in c.runs),
        "warnings": c.warnings,
        "frames": len(c.front),
        "frames_with_ground_truth": max(known),
        "frames_in_doubt": [],  # nothing is judged; kept for programs that read it
        "frames_ignored": [list(r) for r in c.truth.ignored],
        "gaps_before_frames": c.front.gaps,
        "methods": {
            run.key: method_numbers(run, c) | {"divergence_from_cross_frame_m": away.get(run.key)} for run in c.runs
        },
        "ekf_over_cross_frame": ratios.get("ekf"),
        "error_over_cross_frame": ratios,
        "there_and_back": None,  # not done any more; kept for programs that read it
        "self_test": c.self_test,
        "rig": c.calibration,
        "divergence_from_cross_frame_m": away,
        "local_structure_cc_minus_wc_median_m": _median(c.front.local_difference_m),
        "tracks": c.front.tracks(),
        "timing_ms": {stage: quantiles(values) for stage, values in c.front.times_ms.items()},
        "health": c.inspection,
        "configuration": config_to_toml(c.config),
    }


def method_numbers(run: RunRecord, c: Comparison) -> dict[str, Any]:
    """The figures of one method; those against ground truth are None when it stopped before the last frame."""
    figures: dict[str, Any] = dict.fromkeys(_AGAINST_TRUTH)
    truth, std = c.truth.poses, c.truth.std
    if truth is not None and _complete(run, c):
        figures |= evaluate_run(run.trajectory(), run.relative, truth, std, run.structure)
        figures |= _relative(run.trajectory(), truth)
    end = end_pose(run.trajectory()) or {}
    estimator, dof = run.column("estimator"), run.column("nis_dof").sum()
    return figures | {
        "ms_per_frame_p50": _median(run.column("frontend") + estimator),
        "estimator_ms": quantiles(estimator),
        "frames": len(run),
        "failure": run.failure or None,
        "statuses": dict(Counter(map(str, run.statuses))),
        "path_length_m": path_length_m(run.poses) if len(run) else None,
        "end_std_position_m": end.get("std_position_m"),
        "end_std_heading_deg": end.get("std_heading_deg"),
        "nis_over_dof": float(run.column("nis").sum() / dof) if dof else None,
        "reprojection_rms_px": _median(run.column("reprojection_px")),
        "local_sigma_median_m": _median(run.column("sigma_local_m")),
        "there_and_back": None,
    }


def _complete(run: RunRecord, c: Comparison) -> bool:
    """Whether the method processed all frames of the log."""
    return 0 < len(run) == len(c.front)


def _median(values: Any) -> float | None:
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    return float(np.median(finite)) if len(finite) else None


def _relative(estimate: Trajectory, truth: Trajectory) -> dict[str, Any]:
    """RPE, growth, and errors of straight and turning spans; empty unless most frames in a row have a truth."""
    in_a_row = _consecutive(estimate, truth)
    if in_a_row is None:
        return {}
    stamps_ns, e, t = in_a_row
    position2, rotation2 = mean_squares(e, t, [1])
    result: dict[str, Any] = {
        "rpe_position_rms_m": float(np.sqrt(position2[0])),
        "rpe_rotation_rms_deg": float(np.degrees(np.sqrt(rotation2[0]))),
    }
    for name, found in zip(("", "_rotation"), growth_exponents(e, t) or (), strict=False):
        result |= {f"growth_exponent{name}": found.value, f"growth_exponent{name}_ci95": [found.low, found.high]}
    if len(e) > _TURN_SPAN + 1:
        p, r = relative_errors(e, t, _TURN_SPAN)
        known, turns = np.isfinite(p), turning(stamps_ns, t, _TURN_SPAN)
        for name, mask in (("straight", known & ~turns), ("turning", known & turns)):
            if mask.any():
                result[name] = {
                    "spans": int(mask.sum()),
                    "span_frames": _TURN_SPAN,
                    "position_rms_m": float(np.sqrt((p[mask] ** 2).mean())),
                    "rotation_rms_deg": float(np.degrees(np.sqrt((r[mask] ** 2).mean()))),
                }
    return result


def _consecutive(estimate: Trajectory, truth: Trajectory) -> tuple[NDArray[np.int64], Array, Array] | None:
    """Stamps, poses and truths of frames in a row, the truth NaN where it is not known; None where it rarely is."""
    true = truth_of_frames(estimate.stamps_ns, truth)
    rows = np.flatnonzero(np.isfinite(true).all(axis=(1, 2)))
    if len(rows) < 2:
        return None
    row = slice(rows[0], rows[-1] + 1)
    if not enough_known(true[row]):
        return None
    return estimate.stamps_ns[row], estimate.world_from_cam[row], true[row]


def _over_cross_frame(c: Comparison) -> dict[str, dict[str, Any]]:
    """RMS relative error of each method over that of cross-frame: geometric mean over spans, with 95 % intervals."""
    by_name = {r.name: r for r in c.runs if _complete(r, c)}
    reference = by_name.pop("cross-frame", None)
    if c.truth.poses is None or reference is None:
        return {}
    of_reference = _consecutive(reference.trajectory(), c.truth.poses)
    if of_reference is None:
        return {}
    _, base, true = of_reference
    result = {}
    for run in by_name.values():
        of_run = _consecutive(run.trajectory(), c.truth.poses)
        if of_run is not None and (found := paired_ratio(of_run[1], base, true)) is not None:
            result[run.key] = {
                name: {"value": ratio.value, "ci95": [ratio.low, ratio.high]}
                for name, ratio in zip(("position", "rotation"), found, strict=True)
            }
    return result


def _divergence(c: Comparison) -> dict[str, float]:
    """RMS distance of each method's positions from cross-frame's (or the first method's), metres."""
    runs = [r for r in c.runs if _complete(r, c)]
    if not runs:
        return {}
    reference = next((r for r in runs if r.name == "cross-frame"), runs[0])
    base = reference.poses[:, :3, 3]
    return {
        r.key: float(np.sqrt(((r.poses[:, :3, 3] - base) ** 2).sum(axis=1).mean()))
        for r in runs
        if r is not reference
    }
