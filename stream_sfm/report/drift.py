"""Drift: errors of relative motions against their span, common errors against the truth, and a sentence about all.

Without a truth, and over spans for which its errors exceed the differences of the methods, errors come from halves of
the tracks.
"""

from typing import Any

import numpy as np

from ..evaluation import drift
from ..evaluation.association import matched, truth_of_frames
from ..evaluation.common import NONE, Common, common_errors
from ..evaluation.drift import Compared
from ..evaluation.figures import NEES_INTERVAL
from ..evaluation.relative import enough_known, known_frames
from ..evaluation.relative_consistency import against_truth
from ..evaluation.trajectory import from_first_camera, mean_of_known, nees_pose
from ..geometry import Array
from ..methods import REFERENCE, STEPWISE, key_of
from ..record import record
from ..types import Trajectory
from ..wording import counted, in_a_row
from .records import Comparison, RunRecord
from .tables import of_method

_LEVEL = 1.02  # two errors with a smaller ratio are called alike
_MOST_NAMED = 3  # inconsistent methods that are named with their figures; for more, the range is given


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
    return Against(row, true[row], common_errors([run.poses[row] for run in whole], true[row]))


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
    return {
        "truth_tells": against is not None and _truth_separates(table, reference),
        "against": "truth" if against is not None else "halves" if halves else None,
        "reference": reference,
        "as_is": c.as_is,
        "common": common_in_numbers(NONE if against is None else against.common),
        "curves": drift.curves(methods),
        "table": table,
    }


def _add_factors(table: list[dict[str, Any]], c: Comparison, against: Against) -> None:
    """Add to the table the factor by which σ of relative motions would have to grow, if the truth can show it."""
    for run in whole_runs(c):
        truth = Trajectory(run.stamps_ns[against.row], against.corrected)
        factors = {f["frames"]: f["factor"] for f in against_truth(run.relative, truth, c.truth.std)}
        for line in table:
            of = line["methods"][run.key]
            of["sigma_factor"] = None if of["position_from_halves"] else factors.get(line["frames"])


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


def consistency_of(c: Comparison, run: RunRecord, against: Against | None, truth_tells: bool) -> dict[str, Any]:
    """Return the factor by which σ of the pose would have to grow, and its source.

    The source is halves of the tracks if there is no truth, or if it shows only its own errors.
    """
    nees = None
    if c.truth.poses is not None:
        common, estimate = NONE if against is None else against.common, run.trajectory()
        rows, true = matched(estimate, c.truth.poses)
        if len(rows) >= 2 and rows[0] == 0 and estimate.cov_pose is not None:
            poses = from_first_camera(common.applied(true.world_from_cam))
            nees = mean_of_known(
                nees_pose(estimate.world_from_cam[rows], estimate.cov_pose[rows], poses, c.truth.std)
            )
    of_halves = c.halves[run.name].nees_mean if run.name in c.halves else None
    by_truth = nees is not None and (truth_tells or of_halves is None)
    known_from, used = ("truth", nees) if by_truth else ("halves", of_halves)
    return {
        "nees_pose_mean_without_common": nees,
        "sigma_factor": None if used is None else float(np.sqrt(used / 6)),
        "sigma_factor_from": None if used is None else known_from,
    }


def in_words(content: dict[str, Any], methods: dict[str, Any]) -> str:
    """Return the first line of page, terminal and report.json: who is ahead over which spans, with consistency."""
    found = [_who_is_ahead(content), _which_hold(methods, content["as_is"])]
    if content["common"] is not None:
        found.append(f"All methods share {content['common']['text']}, which is removed here")
    sentences = [sentence for sentence in found if sentence]
    if not sentences:
        return "There is no ground truth for these frames."
    if content["against"] == "halves":
        sentences.insert(0, "There is no ground truth: errors come from halves of the tracks")
    return " ".join(f"{sentence}." for sentence in sentences)


def _who_is_ahead(content: dict[str, Any]) -> str:
    """Compare the window with the reference; empty if one of them is missing or the log is too short."""
    mine, theirs = key_of(REFERENCE), content["reference"]
    lines = [
        (line["frames"], ratio, of["position_from_halves"])
        for line in content["table"]
        if (of := line["methods"].get(mine)) and (ratio := of.get(f"position_over_{theirs}"))
    ]
    if not lines:
        return ""
    names = of_method(theirs).name, of_method(mine).name
    if content["against"] == "truth" and all(of_halves for *_, of_halves in lines):
        (first, ratio, _), (last, at_last, _) = lines[0], lines[-1]
        return (
            f"The truth cannot separate {names[1]} from {names[0]}; by halves of the tracks, the error of {names[0]} "
            f"is {_times(ratio, inverse=True)} that of {names[1]} over {_frames(first)}, "
            f"{_times(at_last, inverse=True)} over {last}"
        )
    before, behind = _crossing(content, mine, theirs)
    if before and not behind:
        frames, ratio, of_halves = lines[0]
        return (
            f"{names[0].capitalize()} is ahead up to {_frames(before)}: the error of {names[1]} is "
            f"{_times(ratio)} as large over {_frames(frames)}{_source(of_halves, content)}, "
            f"{_times(lines[-1][1])} over {lines[-1][0]}"
        )
    frames, ratio, of_halves = lines[-1]
    at_last = (
        f"the error of {names[0]} is {_times(ratio, inverse=True)} as large over {_frames(frames)}"
        f"{_source(of_halves, content)}"
    )
    if before:
        return f"{names[0].capitalize()} is ahead up to {_frames(before)}, {names[1]} from {behind} on: {at_last}"
    if behind:
        since = "over every span" if behind == 1 else f"from {_frames(behind)} on"
        return f"{names[1].capitalize()} is ahead of {names[0]} {since}: {at_last}"
    return f"{names[1].capitalize()} and {names[0]} are level: {at_last}"


def _source(of_halves: bool, content: dict[str, Any]) -> str:
    """Say if a ratio comes from halves although there is a truth."""
    return " by halves of the tracks, as the truth cannot separate them" * (
        of_halves and content["against"] == "truth"
    )


def _crossing(content: dict[str, Any], mine: str, theirs: str) -> tuple[int, int]:
    """Return the span up to which the reference is ahead, and from which the window is; 0 if there is none."""
    curves, methods = content["curves"], content["curves"]["methods"]
    frames = np.array(curves["frames"])
    a, b = (np.array([x[0] for x in methods[key]["position_rms_m"]], float) for key in (mine, theirs))
    if content["against"] == "truth":  # spans over which the truth cannot separate them are left out
        of_mine = ((line["frames"], line["methods"].get(mine, {})) for line in content["table"])
        decided = frames > max((span for span, of in of_mine if of.get("position_from_halves")), default=0)
        frames, a, b = frames[decided], a[decided], b[decided]
    behind, ahead = a > _LEVEL * b, b > _LEVEL * a
    before = int(frames[: int(np.argmin(np.append(behind, False)))].max(initial=0))
    last = len(frames) - int(np.argmin(np.append(ahead[::-1], False)))
    return before, int(frames[last]) if last < len(frames) else 0


def _frames(n: int) -> str:
    return counted(n, "frame")


def _times(ratio: dict[str, Any], inverse: bool = False) -> str:
    values = [ratio["value"], *(ratio["ci95"] or ())]
    value, *ends = [1 / x for x in values] if inverse else values
    return f"{value:.2f}{' [{:.2f}, {:.2f}]'.format(*sorted(ends)) if ends else ''} times"


def _which_hold(methods: dict[str, Any], as_is: bool) -> str:
    """Say which covariances hold, and how wrong those of the other methods are; for many methods, give the range."""
    low, high = (np.sqrt(x / 6) for x in NEES_INTERVAL)
    factors = {key: factor for key, of in methods.items() if (factor := of["sigma_factor"]) is not None}
    hold = [of_method(key).name for key, factor in factors.items() if low <= factor <= high]
    wrong = {key: factor for key, factor in factors.items() if not low <= factor <= high}
    by_halves = any(figures["sigma_factor_from"] == "halves" for figures in methods.values())
    source = (
        ", by halves of the tracks," if by_halves else "" if as_is else ", with the calibration taken as exact,"
    )
    text = f"Covariances{source} are consistent for {in_a_row(hold)}" if hold else ""
    if not wrong:
        return text
    text += ", not for " if text else f"Covariances{source} are not consistent for "
    if len(wrong) <= _MOST_NAMED:
        return text + in_a_row([f"{of_method(key).name} ({_off(size)})" for key, size in wrong.items()])
    mine = wrong.pop(key_of(REFERENCE), None)
    others = (
        f"{len(wrong)} {'methods' if mine is None and not hold else 'others'} ({_off(*sorted(wrong.values()))})"
    )
    return text + (others if mine is None else f"{of_method(REFERENCE).name} ({_off(mine)}) and {others}")


def _off(*sizes: float) -> str:
    """Say by how much σ is too small or too large."""
    least, most = (
        (f"{float(f'{max(x, 1 / x):.2g}'):g}", "small" if x > 1 else "large") for x in (sizes[0], sizes[-1])
    )
    if least[1] != most[1]:
        return f"σ up to {least[0]} times too {least[1]} and {most[0]} times too {most[1]}"
    ends = sorted({least[0], most[0]}, key=float)
    return f"σ {' to '.join(ends)} times too {least[1]}"
