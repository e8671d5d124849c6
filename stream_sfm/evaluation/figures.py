"""The figures on the terminal and on pages, by their keys in summary.json and report.json: one list for both."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

NEES_INTERVAL = (1.24, 14.45)  # 95 % of one pose, 6 expected: poses of a log share their errors
ERRORS, STRUCTURE = "errors", "structure"  # families of lengths, whose unit depends on their size


class Figure(NamedTuple):
    """A figure by its key.

    `unit`: for a family of lengths, the unit is chosen on display; `best`: whether the smallest value is marked;
    `expected`: values above this range are marked.
    """

    key: str
    name: str
    unit: str = ""
    best: bool = False
    expected: tuple[float, float] | None = None


ACCURACY = (
    Figure("ate_rmse_aligned_m", "ATE aligned", ERRORS, best=True),
    Figure("final_drift_percent", "final drift", "%", best=True),
    Figure("t_rel_percent", "t_rel", "%", best=True),
    Figure("r_rel_deg_per_100m", "r_rel", "°/100 m", best=True),
)
CONSISTENCY = (Figure("nees_pose_mean", "NEES", "6 expected", expected=NEES_INTERVAL),)
# Figures of a comparison, without the errors that all methods share.
CONSISTENCY_COMPARED = (
    Figure("nees_pose_mean_without_common", "NEES", "6 expected", expected=NEES_INTERVAL),
    Figure("nees_pose_mean", "NEES, with what all share", "6 expected"),
)
# Figures if the errors of the truth exceed the differences of the methods.
CONSISTENCY_OF_HALVES = (
    Figure("sigma_factor", "σ would have to grow by", "from halves of the tracks"),
    Figure("nees_pose_mean_without_common", "NEES, of the truth's errors", "6 expected"),
    Figure("nees_pose_mean", "NEES, with what all share", "6 expected"),
)
ABSOLUTE = (Figure("ate_rmse_m", "ATE", ERRORS), Figure("scale_error_percent", "scale", "%"))
LOCAL = (
    Figure("local_structure_median_m", "local structure", STRUCTURE),
    Figure("local_structure_error_over_sigma", "… over σ", "1 expected"),
    Figure("global_structure_rms_m", "test points in the world", STRUCTURE),
    Figure("global_structure_error_over_sigma", "… over σ", "1 expected"),
)
# σ in two figures: what is each motion's own, and what the rig adds to all motions of a run alike.
SIGMA = (
    Figure("own_motion_over_sigma", "own motion over σ", "1 expected"),
    Figure("rig_over_sigma", "rig over σ"),
)
OF_RUNS = (
    *SIGMA,
    Figure("ate_rmse_sim3_m", "ATE, Sim(3)", ERRORS),
    Figure("metres_per_unit", "one unit", "m"),
)
NIS = Figure("nis_over_dof", "NIS", "1 expected")
TIME = (Figure("ms_per_frame_p50", "time", "ms per frame"),)
WITHOUT_TRUTH = (
    Figure("sigma_factor", "σ would have to grow by", "1 expected"),
    Figure("divergence_from_cross_frame_m", "away from cross-frame", ERRORS),
    Figure("end_std_position_m", "σ at the end", ERRORS),
    Figure("end_std_heading_deg", "σ of the heading", "°"),
    NIS,
)
OF_COMPARISON = (
    *ABSOLUTE,
    *LOCAL,
    Figure("rpe_position_rms_m", "error per frame", ERRORS),
    Figure("rpe_rotation_rms_deg", "rotation per frame", "°"),
    Figure("growth_exponent", "growth", "1 random, 2 bias"),
)


class LengthUnit(NamedTuple):
    """A unit of length: its name, and how many of it make a metre."""

    name: str
    per_m: float


METRES, MILLIMETRES = LengthUnit("m", 1.0), LengthUnit("mm", 1e3)


def unit_for(*lengths_m: ArrayLike) -> LengthUnit:
    """Return millimetres if all known lengths of a family are below a metre, else metres."""
    known = np.concatenate([np.empty(0), *(np.asarray(x, float).ravel() for x in lengths_m)])
    return METRES if (abs(known) >= 1).any() else MILLIMETRES


def units_of(runs: Sequence[Mapping[str, Any]], figures: Sequence[Figure]) -> dict[str, LengthUnit]:
    """Return the unit of each family of lengths among the figures of some runs, the same wherever they are shown."""
    return {
        family: unit_for([x for run in runs for f in figures if f.unit == family and (x := run.get(f.key)) is not None])
        for family in (ERRORS, STRUCTURE)
    }


def number_text(value: float, factor: float = 1.0) -> str:
    """Return a number with three significant digits, or all before the point; the minus is that of a keyboard."""
    x = factor * value
    return (f"{x:.0f}" if 1000 <= abs(x) < 1e6 else f"{x:#.3g}").rstrip(".")
