"""Finds what is wrong with a calibration and says in sentences what to change.

Nine well-calibrated logs (KITTI, EuRoC, rendered) have row offsets of at most 0.34 px, spreads of at most 0.30 px, and
0.2 % of negative disparities. The thresholds stand clear of that.
"""

from collections.abc import Sequence

import numpy as np

from ..camera.rig import StereoRig
from ..recording.rig import REMEDY, right_is_left
from ..recording.topics import PairChoice
from .calibration_check import CalibrationCheck, Corners, Images, check_calibration, matched_corners

Findings = tuple[list[str], list[str]]  # problems: stereo cannot work; warnings: it works worse

_EQUAL_SCALES = 0.01  # width and height that changed by factors this close were resized, not cropped
# A calibration beyond either may be that of exchanged cameras, which is tried.
_ROW_ERROR_PX = 0.5
_NEGATIVE_SHARE = 0.05  # of the matches with negative disparity, from which on it is reported as well
_SWAPPED_SHARE = 0.5  # of the matches with negative disparity: most of the scene is beyond infinity
_CLEARLY_BETTER = 0.5  # a row error below this share of the other one decides
_UNSWAPPED_SHARE = 0.1  # at most so many with the images exchanged, where the rows show that they are
# Median and spread of the row differences of matched corners, from which on each is a warning, and a problem.
_ROW_OFFSET_PX, _ROW_SPREAD_PX = (0.5, 2.0), (0.8, 3.0)
# Offsets of stamps beyond both are reported: at 50 px of motion per frame, 0.02 periods are one pixel.
_STAMP_OFFSET_MS, _STAMP_OFFSET_PERIODS = 1.0, 0.02


def size_problem(size: tuple[int, int], rig: StereoRig) -> str | None:
    """Report images of another size (width, height) than the calibrated one."""
    calibrated = (rig.left.width, rig.left.height)
    if size == calibrated:
        return None
    sx, sy = (a / b for a, b in zip(size, calibrated, strict=True))
    resized = (
        f"they seem to be resized by {sx:.3g}: multiply fx, fy, cx, cy of K (and P) by it as well"
        if abs(sx - sy) < _EQUAL_SCALES
        else "they seem to be cropped: subtract the corner of the crop from cx, cy"
    )
    return (
        f"images are {size[0]}×{size[1]}, the calibration is for {calibrated[0]}×{calibrated[1]}; {resized}; "
        f"{REMEDY}"
    )


def calibration_findings(
    rig: StereoRig, check: CalibrationCheck, corners: Sequence[Corners], choice: PairChoice
) -> Findings:
    """Report the first cause that explains the check of these corners; what else the rows show follows from it."""
    swapped = check
    if not (check.row_error_px <= _ROW_ERROR_PX and check.negative_share <= _NEGATIVE_SHARE):
        swapped = check_calibration(rig, [(right, left) for left, right in corners])
    if (problem := _side_problem(rig, check, swapped, choice)) is not None:
        return [problem], []
    problems, warnings = _row_findings(check)
    if check.negative_share > _NEGATIVE_SHARE:  # too few for cameras that are swapped
        warnings.append(
            f"{100 * check.negative_share:.0f} % of the matches have negative disparity, as if they lay beyond "
            "infinity: the angle between the cameras (rotation of right_from_left, or R) or a principal point (cx) is "
            "wrong, and all depths with it"
        )
    return problems, warnings


def quick_problems(rig: StereoRig, choice: PairChoice, frames: Sequence[Images]) -> list[str]:
    """Return what prevents a replay with this calibration, as `inspect_log` would report it of these frames."""
    corners = [matched_corners(*images) for images in frames]
    return calibration_findings(rig, check_calibration(rig, corners), corners, choice)[0]


def stamp_warning(offset_ms: float, period_ms: float, right: str) -> str | None:
    """What to say of stamps that differ, by the median `offset_ms`, by more than a small part of the period."""
    if abs(offset_ms) <= max(_STAMP_OFFSET_MS, _STAMP_OFFSET_PERIODS * period_ms):
        return None
    other_ms = offset_ms - np.sign(offset_ms) * period_ms
    return (
        f"the stamps of {right} differ from the left ones by {offset_ms:+.1f} ms (or by {other_ms:+.1f} ms, if the "
        "images belong to the neighbouring frame): if the cameras are triggered together, correct the stamps; if "
        "they are not, moving scenes do not fit"
    )


def _side_problem(
    rig: StereoRig, check: CalibrationCheck, swapped: CalibrationCheck, choice: PairChoice
) -> str | None:
    """Report left and right exchanged: in the calibration, in the images, or in both."""
    if np.isnan(check.negative_share):
        return None
    negative_m = right_is_left(rig)
    share = f"{100 * check.negative_share:.0f} % of the matches have negative disparity"
    swap = f"{choice.right} as left and {choice.left} as right"
    # Cameras that converge have disparities of both signs in their images; there the rows decide.
    rows_better = swapped.row_error_px < _CLEARLY_BETTER * check.row_error_px
    rows_decide = rows_better and check.row_error_px > _ROW_ERROR_PX and swapped.negative_share < _UNSWAPPED_SHARE
    if check.negative_share <= _SWAPPED_SHARE and negative_m is not None:
        return (
            f"the sign of the baseline is wrong: by the calibration the right camera stands {negative_m:.4g} m to "
            "the left of the left one, while the images show left and right as they are named; P[3] of the right "
            f"camera must be −fx·baseline, so negate it (or translation_m of right_from_left); {REMEDY}"
        )
    if negative_m is not None:
        return (
            f"left and right are swapped: by the calibration the right camera stands {negative_m:.4g} m to the left "
            f"of the left one, and {share}; name {swap}"
        )
    if check.negative_share > _SWAPPED_SHARE or rows_decide:
        rows = (
            f"with the images exchanged matched corners lie on one row to {swapped.row_error_px:.2f} px, but only to "
            f"{check.row_error_px:.2f} px as they are"
        )
        return (
            f"the images are swapped: {rows if rows_decide else share}, while the calibration has left and right as "
            f"they are named; name {swap} and give a calibration of that pair, or exchange the names of the image "
            "topics"
        )
    return None


def _row_findings(check: CalibrationCheck) -> Findings:
    """Report matches that do not lie on one row."""
    if not np.isfinite(check.vertical_px):
        return [], [f"the calibration could not be checked: only {check.matches} corners match left to right"]
    offset_px, spread_px = abs(check.vertical_px), check.vertical_spread_px
    text = f"the rows of matched corners differ by {check.vertical_px:+.2f} ± {spread_px:.2f} px"
    if offset_px > _ROW_OFFSET_PX[1] or spread_px > _ROW_SPREAD_PX[1]:
        return [
            f"{text}: the calibration does not belong to these images (or these are rectified already: name their "
            f"topics image_rect), or left and right are not of one moment; {REMEDY}"
        ], []
    if offset_px > _ROW_OFFSET_PX[0] or spread_px > _ROW_SPREAD_PX[0]:
        return [], [f"{text}: the calibration is not accurate, or the cameras are not triggered together"]
    return [], []
