"""The page of one run: where it went and what it saw, its errors and σ, statuses and time."""

from typing import Any

import numpy as np

from ..types import Trajectory
from . import calibration_field, charts, pictures
from .calibration_field import CalibrationError
from .figures import ACCURACY, FURTHER, table
from .lengths import UNSCALED, LengthUnit, unit_for
from .methods import label
from .records import RunRecord
from .template import render
from .traces import Trace, trace_of
from .verdict import EXPECTED_NEES
from .view import View

_POINTS = {"tracked": "m-cross-frame", "used": "m-iterated-ekf", "new": "m-ekf", "rejected": "m-frame-to-frame"}
_STAGES = {"decode": "m-truth", "frontend": "m-iterated-ekf", "estimator": "m-ekf", "total": "m-cross-frame"}


def render_run(
    summary: dict[str, Any],
    run: RunRecord,
    truth: Trajectory | None = None,
    calibration: CalibrationError | None = None,
    view: View | None = None,
) -> str:
    """Render a run as HTML from its summary and record, and from its truth and the calibration's error, if known."""
    estimate = run.trajectory()
    found = None if truth is None else trace_of(estimate, truth)
    traces = {} if found is None else {run.name: found}
    unscaled, against = summary["unscaled"], summary.get("ground_truth") or {}
    unit = UNSCALED if unscaled else _errors_unit(estimate, found)
    units = {"errors": unit, "structure": unit_for([against.get("local_structure_median_m") or 0.0])}
    listed = [against] if against and not unscaled else []
    return render(
        "run.html.j2",
        title=summary["log"].rsplit("/", 1)[-1],
        s=summary,
        method=label(summary["method"]),
        unit="units" if unscaled else "m",
        conclusion=conclusion_of_run(summary),
        accuracy=table((*ACCURACY, *FURTHER), listed, units),
        path=charts.path({run.name: run.poses}, traces, unit, "units" if unscaled else "m"),
        view="" if view is None else view.figure(),
        errors=charts.error_and_sigma(estimate, found, run.name, unit),
        consistency=_consistency(summary),
        field=calibration_field.picture(calibration),
        timeline=pictures.timeline([run], len(run), ()),
        work=[
            charts.columns(run, "Points", "points", _POINTS),
            charts.columns(run, "Time per frame", "ms", _STAGES, smooth=True),
        ],
    )


def conclusion_of_run(summary: dict[str, Any]) -> str:
    """What the run shows, in a few plain sentences."""
    frames, truth = summary["frames"], summary.get("ground_truth")
    said = [f"{problem}." for problem in summary["problems"]]
    bad = [f"{frames[name]} {name}" for name in ("degraded", "lost", "dropped") if frames[name]]
    state = f"{frames['estimated']} frames were estimated"
    said.append(f"{state}, {', '.join(bad)}." if bad else f"{state}, none of them degraded or lost.")
    if truth and truth.get("ate_rmse_aligned_m") is not None:
        unit = unit_for([truth["ate_rmse_aligned_m"]])
        off = f"The path is off by {unit.per_m * truth['ate_rmse_aligned_m']:.3g} {unit.name} RMS after alignment"
        drift = truth["final_drift_percent"]
        said.append(f"{off}." if drift is None else f"{off}, and ends {drift:.2g} % of its length from the truth.")
        if (nees := truth.get("nees_pose_mean")) is not None:
            times = float(np.sqrt(nees / EXPECTED_NEES))
            said.append(
                f"Its errors are {times:.2g} times as large as the estimated σ (NEES {nees:.3g}, "
                f"{EXPECTED_NEES:.0f} expected)."
            )
    elif end := summary.get("end"):
        said.append(f"There is no ground truth; σ of the position at the end is {end['std_position_m']:.2g} m.")
    if not summary["complete"]:
        said.append("The run is not complete; the warnings say why.")
    return " ".join(said)


def _errors_unit(estimate: Trajectory, found: Trace | None) -> LengthUnit:
    """Of the errors of the position, or where they are not known of its σ."""
    sigma = None if estimate.cov_pose is None else np.sqrt(np.trace(estimate.cov_pose[:, :3, :3], axis1=1, axis2=2))
    return unit_for(sigma if found is None else found.position_m)


def _consistency(summary: dict[str, Any]) -> tuple[list[int], list[tuple[str, dict[int, float]]]]:
    """Spans in frames, and rows of error over σ by span: against ground truth, and of halves against each other."""
    against = (summary.get("ground_truth") or {}).get("relative_consistency")
    found = {"against ground truth": against or []}
    found |= {f"halves of the {half}": rows for half, rows in (summary.get("self_test") or {}).items()}
    rows = [(name, {row["frames"]: row["factor"] for row in spans}) for name, spans in found.items() if spans]
    return sorted({span for _, factors in rows for span in factors}), rows
