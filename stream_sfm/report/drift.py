"""Drift: errors of relative motions against their span, and common errors against the truth.

Without a truth, and over spans for which its errors exceed the differences of the methods, errors come from halves of
the tracks.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..evaluation import drift
from ..evaluation.association import matched, truth_of_frames
from ..evaluation.common import NONE, Common, common_errors
from ..evaluation.drift import Compared
from ..evaluation.relative import enough_known, known_frames
from ..evaluation.relative_consistency import against_truth
from ..evaluation.trajectory import from_first_camera, mean_of_known, nees_pose
from ..geometry import Array
from ..methods import REFERENCE, REPLAYED, STEPWISE, key_of
from ..record import record
from ..types import Trajectory
from .conclusion import verdict_of
from .records import Comparison, RunRecord


@record
class Against:
    """The truth of consecutive frames: `row` among all frames, `poses` (n, 4, 4) with NaN, `common` errors."""

    row: slice
    poses: Array
    common: Common

    @property
    def corrected(self) -> Array:
        """The truth with the errors that the motions of all methods share."""
        return self.common._replace(start_rad=np.zeros(3)).applied(self.poses)


def whole_runs(c: Comparison) -> list[RunRecord]:
    """Return the runs that have an estimate of every frame."""
    return [run for run in c.runs if 0 < len(run) == len(c.front)]


def truth_in_a_row(c: Comparison) -> Against | None:
    """Return the truth with which methods are compared; None if few frames have one."""
    whole = whole_runs(c)
    if not whole or c.truth.poses is None:
        return None
    true = truth_of_frames(whole[0].stamps_ns, c.truth.poses)
    rows = np.flatnonzero(known_frames(true))
    if len(rows) < 2 or not enough_known(true[rows[0] : rows[-1] + 1]):
        return None
    row = slice(rows[0], rows[-1] + 1)
    alike = [run for run in whole if run.name != REPLAYED]  # with one calibration
    return Against(row, true[row], common_errors([run.poses[row] for run in alike or whole], true[row]))


def reference_of(c: Comparison) -> str:
    """Return the key of the method by whose errors those of the others are divided: the one whose errors accumulate."""
    keys = [run.key for run in c.runs]
    return next((key for key in map(key_of, (STEPWISE, REFERENCE)) if key in keys), keys[0])


def drift_of(c: Comparison, against: Against | None) -> dict[str, Any]:
    """Return the section `drift` of report.json."""
    halves = {run.key: Compared.of_halves(c.halves[run.name].poses) for run in c.runs if run.name in c.halves}
    reference, methods = reference_of(c), halves
    if against is not None:
        methods = {run.key: Compared(run.poses[against.row], against.corrected) for run in whole_runs(c)}
    table = drift.table(methods, reference, halves or None)
    if against is not None:
        _add_factors(table, c, against)
    separates = against is not None and _truth_separates(table, reference)
    decided_by = methods if separates or not halves else halves
    return {
        "truth_separates": separates,
        "against": "truth" if against is not None else "halves" if halves else None,
        "reference": reference,
        "as_is": c.as_is,
        "common": common_in_numbers(NONE if against is None else against.common),
        "curves": drift.curves(methods),
        "table": table,
        "verdict": _verdict(decided_by, against is not None and decided_by is methods),
    }


def _verdict(methods: Mapping[str, Compared], of_truth: bool) -> dict[str, Any] | None:
    """Return the verdict on methods with one calibration, and what it is `against`."""
    verdict = verdict_of({key: compared for key, compared in methods.items() if key != key_of(REPLAYED)})
    return None if verdict is None else {"against": "truth" if of_truth else "halves", **verdict}


def _add_factors(table: list[dict[str, Any]], c: Comparison, against: Against) -> None:
    """Add to the table the factors by which σ of relative motions would have to grow, if the truth can show them."""
    for run in whole_runs(c):
        truth = Trajectory(run.stamps_ns[against.row], against.corrected)
        factors = {f["frames"]: f for f in against_truth(run.relative, truth, c.truth.std)}
        for line in table:
            of = line["methods"][run.key]
            found = {} if of["position_from_halves"] else factors.get(line["frames"], {})
            of |= {f"sigma_{name}": found.get(name) for name in ("factor", "factor_own")}


def common_in_numbers(common: Common) -> dict[str, Any] | None:
    """Return the errors that all methods share, as in report.json; None if there are none."""
    if not common.any:
        return None
    return {
        "start_deg": np.degrees(common.start_rad).tolist(),
        "turn_deg": np.degrees(common.turn_rad).tolist(),
        "scale_percent": 100 * common.scale,
        "text": common.in_words(),
    }


def _truth_separates(table: list[dict[str, Any]], reference: str) -> bool:
    """Whether the truth separates methods from the reference in most comparisons; true without comparisons."""
    found = [
        not of["position_from_halves"] for line in table for key, of in line["methods"].items() if key != reference
    ]
    return 2 * sum(found) > len(found) or not found


def needs_halves(c: Comparison) -> bool:
    """Whether the methods must be estimated from halves of the tracks, because the truth does not separate them."""
    against = truth_in_a_row(c)
    if against is None:
        return bool(whole_runs(c))
    lines = drift_of(c, against)["table"]
    return any(of["position_from_halves"] for line in lines for of in line["methods"].values())


def consistency_of(c: Comparison, run: RunRecord, against: Against | None, truth_separates: bool) -> dict[str, Any]:
    """Return the factor by which σ of the pose would have to grow, and its source.

    The source is halves of the tracks if there is no truth, or if it shows only its own errors.
    """
    nees = None
    if c.truth.poses is not None:
        shared = against is not None and run.name != REPLAYED
        common, estimate = against.common if against is not None and shared else NONE, run.trajectory()
        rows, true = matched(estimate, c.truth.poses)
        if len(rows) >= 2 and rows[0] == 0 and estimate.cov_pose is not None:
            poses = from_first_camera(common.applied(true.world_from_cam))
            nees = mean_of_known(nees_pose(estimate.world_from_cam[rows], estimate.cov_pose[rows], poses, c.truth.std))
    of_halves = c.halves[run.name].nees_mean if run.name in c.halves else None
    by_truth = nees is not None and (truth_separates or of_halves is None)
    known_from, used = ("truth", nees) if by_truth else ("halves", of_halves)
    return {
        "nees_pose_mean_without_common": nees,
        "sigma_factor": None if used is None else float(np.sqrt(used / 6)),
        "sigma_factor_from": None if used is None else known_from,
    }
