"""What is wrong with a calibration, in sentences that say what to change: for `stream-sfm inspect`."""

import numpy as np

from ..camera.rig import StereoRig
from ..recording.rig import CURE, right_is_left
from ..recording.topics import PairChoice
from .calibration_check import CalibrationCheck

Findings = tuple[list[str], list[str]]  # problems: stereo cannot work; warnings: it works worse
_NEGATIVE_SHARE = 0.05  # of the matches; logs that are calibrated well have a hundredth of it


def size_problem(size: tuple[int, int], rig: StereoRig) -> str | None:
    """Images of another size (width, height) than the calibrated one."""
    calibrated = (rig.left.width, rig.left.height)
    if size == calibrated:
        return None
    sx, sy = (a / b for a, b in zip(size, calibrated, strict=True))
    resized = (
        f"they seem to be resized by {sx:.3g}: multiply fx, fy, cx, cy of K (and P) by it as well"
        if abs(sx - sy) < 0.01
        else "they seem to be cropped: subtract the corner of the crop from cx, cy"
    )
    return (
        f"images are {size[0]}×{size[1]}, the calibration is for {calibrated[0]}×{calibrated[1]}; {resized}; {CURE}"
    )


def calibration_findings(
    rig: StereoRig, check: CalibrationCheck, swapped: CalibrationCheck, choice: PairChoice
) -> Findings:
    """The first cause that explains the check; what else the rows say follows from it. `swapped`: the check of the
    same images with left and right exchanged.
    """
    if (problem := side_problem(rig, check, swapped, choice)) is not None:
        return [problem], []
    problems, warnings = scale_findings(rig)
    if problems:
        return problems, warnings
    more_problems, more_warnings = row_findings(check)
    return more_problems, warnings + more_warnings + disparity_warnings(check)


def scale_findings(rig: StereoRig) -> Findings:
    """Intrinsics that belong to images of another size: the principal point tells."""
    problems, warnings = [], []
    for name, camera in (("left", rig.left), ("right", rig.right)):
        cx, cy = camera.K[0, 2], camera.K[1, 2]
        sx, sy = 2 * cx / camera.width, 2 * cy / camera.height
        size = f"{camera.width}×{camera.height}"
        text = f"the {name} principal point ({cx:.0f}, {cy:.0f}) is far from the centre of {size} images"
        if abs(sx - sy) < 0.1 * sx and abs(sx - 1) > 0.2:
            problems.append(
                f"{text}: K seems to belong to images of about {2 * cx:.0f}×{2 * cy:.0f}; scale K (and P) with the "
                f"images, that is by {2 / (sx + sy):.2g}, or {CURE}"
            )
        elif max(abs(sx - 1), abs(sy - 1)) > 0.5:
            problems.append(f"{text}: K does not belong to these images; {CURE}")
        elif max(abs(sx - 1), abs(sy - 1)) > 0.3:
            warnings.append(f"{text}: were the images cropped after the calibration?")
    return problems, warnings


def side_problem(
    rig: StereoRig, check: CalibrationCheck, swapped: CalibrationCheck, choice: PairChoice
) -> str | None:
    """Left and right exchanged, in the calibration, in the images, or in both."""
    if np.isnan(check.negative_share):
        return None
    negative_m = right_is_left(rig)
    share = f"{100 * check.negative_share:.0f} % of the matches have negative disparity"
    swap = f"{choice.right} as left and {choice.left} as right"
    # cameras that converge have disparities of both signs in their images; there the rows tell
    rows_tell = swapped.row_error_px < 0.5 * check.row_error_px > 0.25 and swapped.negative_share < 0.1
    if check.negative_share <= 0.5 and negative_m is not None:
        return (
            f"the sign of the baseline is wrong: by the calibration the right camera stands {negative_m:.4g} m to "
            "the left of the left one, while the images show left and right as they are named; P[3] of the right "
            f"camera must be −fx·baseline, so negate it (or translation_m of right_from_left); {CURE}"
        )
    if negative_m is not None:
        return (
            f"left and right are swapped: by the calibration the right camera stands {negative_m:.4g} m to the left "
            f"of the left one, and {share}; name {swap}"
        )
    if check.negative_share > 0.5 or rows_tell:
        rows = (
            f"with the images exchanged matched corners lie on one row to {swapped.row_error_px:.2f} px, as they are "
            f"to {check.row_error_px:.2f} px only"
        )
        return (
            f"the images are swapped: {rows if rows_tell else share}, while the calibration has left and right as "
            f"they are named; name {swap} and give a calibration of that pair, or exchange the names of the image "
            "topics"
        )
    return None


def row_findings(check: CalibrationCheck) -> Findings:
    """Matches that do not lie on one row."""
    if not np.isfinite(check.vertical_px):
        return [], [f"the calibration could not be checked: only {check.matches} corners match left to right"]
    text = f"matched corners differ by {check.vertical_px:+.2f} ± {check.vertical_spread_px:.2f} px in their row"
    if abs(check.vertical_px) > 2 or check.vertical_spread_px > 3:
        return [f"{text}: the calibration does not belong to these images; {CURE}"], []
    if abs(check.vertical_px) > 0.5 or check.vertical_spread_px > 0.8:
        return [], [f"{text}: the calibration is not accurate, or the cameras are not triggered together"]
    return [], []


def disparity_warnings(check: CalibrationCheck) -> list[str]:
    """Matches that would lie beyond infinity, too few for cameras that are swapped."""
    if not check.negative_share > _NEGATIVE_SHARE:  # NaN too
        return []
    return [
        f"{100 * check.negative_share:.0f} % of the matches have negative disparity, as if they lay beyond infinity: "
        "the angle between the cameras (rotation of right_from_left, or R) or a principal point (cx) is wrong, and "
        "all depths with it"
    ]


def offset_warning(offset_ms: float, period_ms: float, right: str) -> str | None:
    """Stamps of left and right that differ by more than a fiftieth of the period."""
    if abs(offset_ms) <= max(1.0, 0.02 * period_ms):
        return None
    other = offset_ms - np.sign(offset_ms) * period_ms
    return (
        f"the stamps of {right} differ from the left ones by {offset_ms:+.1f} ms (or by {other:+.1f} ms, if the "
        "images belong to the neighbouring frame): if the cameras are triggered together, correct the stamps; if "
        "they are not, moving scenes do not fit"
    )


def shift_problem(shift: int, row_error_px: float, check: CalibrationCheck, offset_ms: float, right: str) -> str:
    """Right images that belong to another frame than their stamps say; `offset_ms` is what their stamps are off."""
    return (
        f"the stamps of {right} are off by {offset_ms:+.1f} ms: with right images one frame "
        f"{'later' if shift > 0 else 'earlier'} matched corners lie on one row to {row_error_px:.2f} px, paired by "
        f"their stamps to {check.row_error_px:.2f} px only; add {-offset_ms:+.1f} ms to the stamps"
    )
