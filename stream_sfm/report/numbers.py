"""The content of report.json: every figure of the page, computed from all frames."""

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..config import config_to_toml
from ..evaluation.association import matched, truth_of_frames
from ..evaluation.drift import path_length_m
from ..evaluation.relative import (
    Exponent,
    Ratio,
    enough_known,
    growth_exponents,
    mean_squares,
    paired_ratio,
    relative_errors,
    turning,
)
from ..evaluation.relative_consistency import against_truth
from ..evaluation.summary import evaluate
from ..geometry.se3 import Array
from ..types import Trajectory
from .conclusion import conclusion
from .records import Comparison, MethodRun
from .traces import closure

SCHEMA_VERSION = 1
_FIGURES = (
    "ate_rmse_aligned_m",
    "ate_rmse_m",
    "final_drift_percent",
    "t_rel_percent",
    "r_rel_deg_per_100m",
    "segment_lengths_m",
    "scale_error_percent",
    "nees_pose_mean",
    "local_structure_rms_m",
    "local_structure_median_m",
    "local_structure_error_over_sigma",
    "local_structure_error_over_sigma_median",
    "local_structure_beyond_3_sigma_percent",
    "frames_compared",
    "growth_exponent",
    "growth_exponent_ci95",
    "growth_exponent_rotation",
    "growth_exponent_rotation_ci95",
    "rpe_position_rms_m",
    "rpe_rotation_rms_deg",
    "std_truth",
    "relative_consistency",
    "straight",
    "turning",
)
_TURN_SPAN = 10  # frames over which the camera counts as straight or turning


def numbers(comparison: Comparison) -> dict[str, Any]:
    """Compute the content of report.json; a figure that is not defined for this log is None."""
    c = comparison
    frames = len(c.front.tracked)
    truth_frames = 0
    if c.truth is not None and c.runs:
        truth_frames = max(len(matched(r.trajectory(), c.truth)[0]) if r.poses else 0 for r in c.runs)
    ratios = _over_cross_frame(c)
    content = {
        "schema_version": SCHEMA_VERSION,
        "software_version": __version__,
        "log": c.log,
        "complete": c.complete and not any(r.failure for r in c.runs),
        "warnings": c.warnings,
        "frames": frames,
        "frames_with_ground_truth": truth_frames,
        "frames_in_doubt": [],
        "frames_ignored": [list(r) for r in c.ignored],
        "gaps_before_frames": c.front.gaps,
        "methods": {run.key: method_numbers(run, c) for run in c.runs},
        "ekf_over_cross_frame": ratios.get("ekf"),
        "error_over_cross_frame": ratios,
        "there_and_back": c.return_note,
        "self_test": c.self_test,
        "rig": None if c.calibration is None else c.calibration.numbers,
        "divergence_from_cross_frame_m": _divergence(c),
        "local_structure_cc_minus_wc_median_m": _median([d for _, d in c.local_difference]),
        "tracks": _tracks(c),
        "timing_ms": {
            stage: quantiles(values)
            for stage, values in (
                ("decode", c.front.decode_ms),
                ("rectify", c.front.rectify_ms),
                ("frontend", c.front.frontend_ms),
            )
        },
        "health": c.inspection,
        "configuration": config_to_toml(c.config),
    }
    return content | {"conclusion": conclusion(content).text}


def method_numbers(run: MethodRun, c: Comparison) -> dict[str, Any]:
    """The figures of one method; those against ground truth are None when it stopped before the last frame."""
    figures: dict[str, Any] = dict.fromkeys(_FIGURES)
    if c.truth is not None and _complete(run, c):
        figures |= evaluate(run.trajectory(), c.truth, run.structure)
        figures |= _relative(run.trajectory(), c.truth)
        spans = against_truth(run.relative, c.truth, c.std_truth)
        figures |= {"std_truth": list(c.std_truth), "relative_consistency": spans}
    shared = np.array(c.front.rectify_ms) + np.array(c.front.frontend_ms)
    estimator = np.array(run.estimator_ms)
    dof = sum(run.nis_dof)
    back = closure(run)
    far = back is not None and back.apart_m[-1] > 1e-3
    return figures | {
        "ms_per_frame_p50": _median(shared[: len(estimator)] + estimator),
        "estimator_ms": quantiles(run.estimator_ms),
        "frames": len(run.poses),
        "failure": run.failure or None,
        "statuses": dict(Counter(run.statuses)),
        "path_length_m": path_length_m(np.array(run.poses)) if run.poses else None,
        "nis_over_dof": sum(run.nis) / dof if dof else None,
        "reprojection_rms_px": _median(run.reprojection_px),
        "local_sigma_median_m": _median(run.sigma_local_m),
        "there_and_back": None
        if back is None
        else {
            "end_position_m": float(back.position_m[-1]),
            "end_rotation_deg": float(back.rotation_deg[-1]),
            "end_drift_percent": 100 * float(back.position_m[-1] / back.apart_m[-1]) if far else None,
            "all_frames_drift_percent": 100 * float(np.sqrt((back.position_m**2).sum() / (back.apart_m**2).sum()))
            if far
            else None,
        },
    }


def _complete(run: MethodRun, c: Comparison) -> bool:
    """Whether the method processed all frames of the forward pass; it may have failed on the reversed one."""
    return 0 < len(run.poses) == len(c.front.tracked)


def quantiles(values: Any) -> dict[str, float] | None:
    """Median, 95th percentile and maximum of some values; None where there are none."""
    if not len(values):
        return None
    p50, p95 = np.quantile(values, [0.5, 0.95])
    return {"p50": float(p50), "p95": float(p95), "max": float(np.max(values))}


def interval(found: Exponent | Ratio) -> list[float]:
    """The low and the high end of an interval."""
    return [found.low, found.high]


def _median(values: Any) -> float | None:
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    return float(np.median(finite)) if len(finite) else None


def _relative(estimate: Trajectory, truth: Trajectory) -> dict[str, Any]:
    """RPE, growth, and errors of straight and turning spans; empty unless most frames in a row have a truth."""
    found = consecutive(estimate, truth)
    if found is None:
        return {}
    stamps_ns, e, t = found
    position2, rotation2 = mean_squares(e, t, [1])
    result: dict[str, Any] = {
        "rpe_position_rms_m": float(np.sqrt(position2[0])),
        "rpe_rotation_rms_deg": float(np.degrees(np.sqrt(rotation2[0]))),
    }
    if (growth := growth_exponents(e, t)) is not None:
        result |= {
            "growth_exponent": growth[0].value,
            "growth_exponent_ci95": interval(growth[0]),
            "growth_exponent_rotation": growth[1].value,
            "growth_exponent_rotation_ci95": interval(growth[1]),
        }
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


def consecutive(estimate: Trajectory, truth: Trajectory) -> tuple[NDArray[np.int64], Array, Array] | None:
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
    if c.truth is None or reference is None:
        return {}
    of_reference = consecutive(reference.trajectory(), c.truth)
    if of_reference is None:
        return {}
    _, base, true = of_reference
    result = {}
    for run in by_name.values():
        of_run = consecutive(run.trajectory(), c.truth)
        if of_run is not None and (found := paired_ratio(of_run[1], base, true)) is not None:
            result[run.key] = {
                name: {"value": ratio.value, "ci95": interval(ratio)}
                for name, ratio in zip(("position", "rotation"), found, strict=True)
            }
    return result


def _divergence(c: Comparison) -> dict[str, float]:
    """RMS distance of each method's positions from cross-frame's (or the first method's), metres."""
    runs = [r for r in c.runs if _complete(r, c)]
    if not runs:
        return {}
    reference = next((r for r in runs if r.name == "cross-frame"), runs[0])
    base = np.array(reference.poses)[:, :3, 3]
    return {
        r.key: float(np.sqrt(((np.array(r.poses)[:, :3, 3] - base) ** 2).sum(axis=1).mean()))
        for r in runs
        if r is not reference
    }


def _tracks(c: Comparison) -> dict[str, Any]:
    lengths = np.array([last - first + 1 for first, last in c.front.lives.values()])
    if not len(lengths):
        return {"count": 0, "mean_frames": None, "median_frames": None, "longest_frames": None}
    return {
        "count": len(lengths),
        "mean_frames": float(lengths.mean()),
        "median_frames": float(np.median(lengths)),
        "longest_frames": int(lengths.max()),
    }
