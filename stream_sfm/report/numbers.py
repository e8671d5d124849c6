"""The content of report.json: every figure of the page, computed from all frames."""

from collections import Counter
from typing import Any

import numpy as np

from .. import __version__
from ..config import config_to_toml
from ..evaluation.association import matched
from ..evaluation.drift import KINDS, of_interval
from ..evaluation.figures import (
    ACCURACY,
    CONSISTENCY,
    CONSISTENCY_COMPARED,
    CONSISTENCY_OF_HALVES,
    WITHOUT_TRUTH,
    Figure,
)
from ..evaluation.relative import growth_exponents, paired_ratio, relative_errors, turning
from ..evaluation.summary import FIGURES, end_pose, evaluate_run
from ..methods import REFERENCE
from .conclusion import in_words
from .drift import Against, consistency_of, drift_of, truth_in_a_row, whole_runs
from .records import OF_RUN, Comparison, RunRecord, Truth, median, quantiles

SCHEMA_VERSION = 1
_AGAINST_TRUTH = (
    *FIGURES, "growth_exponent", "growth_exponent_ci95", "growth_exponent_rotation", "growth_exponent_rotation_ci95",
    "rpe_position_rms_m", "rpe_rotation_rms_deg", "std_truth", "relative_consistency",
    "own_motion_over_sigma", "rig_over_sigma", "straight", "turning",
)  # fmt: skip
_NO_CONSISTENCY = dict.fromkeys(("nees_pose_mean_without_common", "sigma_factor", "sigma_factor_from"))
_TURN_SPAN = 10  # span in frames over which the camera counts as straight or turning


def numbers(c: Comparison) -> dict[str, Any]:
    """Compute the content of report.json; a figure that is not defined for this log is None."""
    known = [0]
    if c.truth.poses is not None:
        known += [len(matched(r.trajectory(), c.truth.poses)[0]) for r in c.runs]
    whole, against = whole_runs(c), truth_in_a_row(c)
    ratios, away, of_spans = _over_cross_frame(whole, against), _divergence(whole), drift_of(c, against)
    methods = {}
    for run in c.runs:
        figures = _against_truth(run, c.truth, against) if run in whole else {}
        methods[run.key] = dict.fromkeys(_AGAINST_TRUTH) | figures | _of_run(run)
        methods[run.key] |= (
            consistency_of(c, run, against, of_spans["truth_separates"]) if run in whole else _NO_CONSISTENCY
        )
        methods[run.key]["divergence_from_cross_frame_m"] = away.get(run.key)
    return {
        "schema_version": SCHEMA_VERSION,
        "software_version": __version__,
        "log": c.log,
        "complete": c.complete and not any(r.failure for r in c.runs),
        "warnings": c.warnings,
        "conclusion": in_words(of_spans, methods),
        "frames": len(c.front),
        "frames_with_ground_truth": max(known),
        "frames_ignored": [list(r) for r in c.truth.ignored],
        "gaps_before_frames": c.front.gaps,
        "methods": methods,
        "drift": of_spans,
        "ekf_over_cross_frame": ratios.get("ekf"),
        "error_over_cross_frame": ratios,
        "self_test": c.self_test,
        "rig": c.calibration,
        "divergence_from_cross_frame_m": away,
        "local_structure_cc_minus_wc_median_m": median(c.front.local_difference_m),
        "tracks": c.front.tracks(),
        "timing_ms": {stage: quantiles(values) for stage, values in c.front.times_ms.items()},
        "health": c.inspection,
        "configuration": config_to_toml(c.config),
    }


def figures_of(content: dict[str, Any]) -> tuple[Figure, ...]:
    """Return the main figures of a comparison, for its page and the terminal; `content` of report.json."""
    if not content["frames_with_ground_truth"]:
        return WITHOUT_TRUTH
    if not content["drift"]["truth_separates"]:
        return (*ACCURACY, *CONSISTENCY_OF_HALVES)
    return (*ACCURACY, *(CONSISTENCY_COMPARED if content["drift"]["common"] else CONSISTENCY))


def _of_run(run: RunRecord) -> dict[str, Any]:
    """Return the figures of a method that need no ground truth."""
    end = end_pose(run.trajectory()) or {}
    return {of.figure.key: of.value(run) for of in OF_RUN} | {
        "estimator_ms": quantiles(run.column("estimator")),
        "frames": len(run),
        "failure": run.failure or None,
        "statuses": dict(Counter(map(str, run.statuses))),
        "end_std_position_m": end.get("std_position_m"),
        "end_std_heading_deg": end.get("std_heading_deg"),
    }


def _against_truth(run: RunRecord, truth: Truth, against: Against | None) -> dict[str, Any]:
    """Return the figures of a whole run; RPE, growth and turning spans only where most frames in a row have a truth."""
    if truth.poses is None:
        return {}
    result = evaluate_run(run.trajectory(), run.relative, truth.poses, truth.std, run.structure)
    if against is None:
        return result
    row, t = against.row, against.poses
    e = run.poses[row]
    position_m, rotation_rad = (float(np.sqrt(np.nanmean(errors**2))) for errors in relative_errors(e, t, 1))
    result |= {"rpe_position_rms_m": position_m, "rpe_rotation_rms_deg": float(np.degrees(rotation_rad))}
    for name, found in zip(("", "_rotation"), growth_exponents(e, t) or (), strict=False):
        result |= {f"growth_exponent{name}": found.value, f"growth_exponent{name}_ci95": [found.low, found.high]}
    if len(e) > _TURN_SPAN + 1:
        p, r = relative_errors(e, t, _TURN_SPAN)
        known, turns = np.isfinite(p), turning(run.stamps_ns[row], t, _TURN_SPAN)
        for name, mask in (("straight", known & ~turns), ("turning", known & turns)):
            if mask.any():
                result[name] = {
                    "spans": int(mask.sum()),
                    "span_frames": _TURN_SPAN,
                    "position_rms_m": float(np.sqrt((p[mask] ** 2).mean())),
                    "rotation_rms_deg": float(np.degrees(np.sqrt((r[mask] ** 2).mean()))),
                }
    return result


def _over_cross_frame(whole: list[RunRecord], against: Against | None) -> dict[str, dict[str, Any]]:
    """Return RMS relative errors over those of cross-frame: geometric means over spans, with 95 % intervals."""
    by_name = {r.name: r for r in whole}
    reference = by_name.pop(REFERENCE, None)
    if reference is None or against is None:
        return {}
    row, true, result = against.row, against.corrected, {}
    for run in by_name.values():
        if (found := paired_ratio(run.poses[row], reference.poses[row], true)) is not None:
            result[run.key] = dict(zip(KINDS, map(of_interval, found), strict=True))
    return result


def _divergence(whole: list[RunRecord]) -> dict[str, float]:
    """Return the RMS distance of positions from those of cross-frame (or the first method), metres."""
    reference = next((r for r in whole if r.name == REFERENCE), next(iter(whole), None))
    apart = {r.key: r.poses[:, :3, 3] - reference.poses[:, :3, 3] for r in whole if reference and r is not reference}
    return {key: float(np.sqrt((d**2).sum(axis=1).mean())) for key, d in apart.items()}
