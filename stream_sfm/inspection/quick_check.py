"""Checks a calibration against a few frames of a run, for a fraction of what an inspection of the whole log costs."""

from collections.abc import Sequence

from ..camera.rig import StereoRig
from ..recording.topics import PairChoice
from .calibration_check import Images, check_as_they_are, check_calibration
from .findings import calibration_findings

# A calibration that fits this well cannot be that of exchanged cameras or of images before rectification, so that
# these need not be tried.
_GOOD_ROW_ERROR_PX, _GOOD_NEGATIVE_SHARE = 0.5, 0.05


def quick_problems(rig: StereoRig, choice: PairChoice, frames: Sequence[Images]) -> list[str]:
    """Return what prevents a replay with this calibration, as `inspect_log` would report it of these frames."""
    check = check_calibration(rig, frames)
    swapped = as_they_are = check
    if check.row_error_px > _GOOD_ROW_ERROR_PX or check.negative_share > _GOOD_NEGATIVE_SHARE:
        swapped = check_calibration(rig, [(right, left) for left, right in frames])
        as_they_are = check_as_they_are(rig, frames)
    return calibration_findings(rig, check, swapped, as_they_are, choice)[0]
