"""The verdict on a calibration: whether it fits the images, and what to do if it does not.

It is one sentence, the same from `inspect`, `replay` and `refine`. Causes that are certain come from
`RigEstimate.findings`.
"""

from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from ..camera.refinement import LENS_TERMS, disparity_rms_px
from ..frontend.learnt.row_turn import turn_by_rows
from ..frontend.learnt.rows import Rows
from ..geometry.stereo import StereoProjection
from ..record import record
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import disparity_over_image
from ..rig_model.terms import lens_shift_rms_px
from .motions import shows_focal


class Fit(StrEnum):
    """Whether a calibration fits the images of a run."""

    FITS = "fits"
    CORRECTED = "corrected"  # wrong, and corrected in this run
    WRONG = "wrong"  # rows, focal length or timing: should be corrected before the next run
    NOT_JUDGED = "not judged"


class Verdict(NamedTuple):
    """The fit, and the sentence."""

    fit: Fit
    text: str


@record
class _Rules:
    """What counts as wrong; RMS over the image."""

    # Sound rigs differ by a fifth of a pixel between two recordings. Rows beyond half a pixel cost matches.
    small_px: float = 0.25
    rows_px: float = 0.5
    shown: float = 3.0  # σ from which an error counts
    # Of the disparity: with more, the motion shows nothing, unless thirds of the run agree.
    most_std_px: float = 0.3
    telling: float = 0.1  # share by which a distance is wrong


_RULES = _Rules()
_NOTHING_TRACKED = "not judged: no frame was tracked"
# By eq. (73).
UNSEEN = "no image shows a wrong baseline, or one error of both principal points: compare a length with a tape"


def rows_warning(rows: Rows) -> str:
    """Return that rows differ by more than half a pixel, RMS over the image, and what to do; empty otherwise."""
    if not rows.rms_px > _RULES.rows_px:
        return ""
    differ = f"the rows of left and right differ by {rows.rms_px:.2f} px"
    if turn_by_rows([rows]).is_real:
        return f"{differ}: refine the calibration, which turns the right camera"
    return f"{differ}, which no turn of the right camera explains: calibrate the lenses again"


def verdict(projection: StereoProjection, estimate: RigEstimate, rows: Rows) -> Verdict:
    """Return the verdict on a calibration, from the errors and the rows that a run has found."""
    causes = [f"{cause}: refine the calibration" for cause in estimate.findings()]
    if causes := [*filter(None, [rows_warning(rows)]), *causes]:
        return Verdict(Fit.WRONG, f"wrong: {'; '.join(causes)}")
    further = estimate.further
    std_px = float(np.sqrt((disparity_over_image(projection, estimate, (5, 9))[1] ** 2).mean()))
    disparity_px, lens_px = disparity_rms_px(further), lens_shift_rms_px(projection, further)
    agrees, rows_px = estimate.agrees(LENS_TERMS), rows.rms_px
    if not np.isfinite(rows_px) or (std_px > _RULES.most_std_px and not agrees):
        return Verdict(
            Fit.NOT_JUDGED,
            f"not judged: σ of the disparity is {std_px:.2f} px, as the camera hardly moved or saw few points: carry "
            "it sideways past near things, and turn it",
        )
    refined = estimate.refined is not None and bool(estimate.refined[: len(LENS_TERMS)].any())
    shown = disparity_px > max(_RULES.small_px, _RULES.shown * std_px) or rows_px > _RULES.small_px
    if shown or (estimate.applied and not refined):
        far_m = _RULES.telling * projection.f_px * projection.baseline_m / max(disparity_px, 1e-9)
        sizes = f"{disparity_px:.2f} px of disparity, {rows_px:.2f} px of rows and {lens_px:.2f} px of both lenses"
        return Verdict(
            Fit.CORRECTED,
            f"wrong by {sizes}, and corrected: fine for this run (without that, distances beyond {far_m:.3g} m would "
            f"be wrong by {100 * _RULES.telling:.0f} % or more); refine the calibration to keep the correction",
        )
    known = f", with its refinement of {disparity_rms_px(estimate.mean - further):.2f} px" if refined else ""
    known += "" if shows_focal(estimate) else ", but this motion does not show the focal length"
    fits_px = float(np.sqrt(rows_px**2 + disparity_px**2 + std_px**2))
    return Verdict(Fit.FITS, f"fits the images to {fits_px:.2f} px{known}; {UNSEEN}")


def judged(summary: dict[str, Any]) -> dict[str, str]:
    """Return `fit` and `text` of the verdict in the summary of a run; that nothing was tracked if there is none."""
    rig = summary.get("rig")
    if rig is None:
        return {"fit": str(Fit.NOT_JUDGED), "text": _NOTHING_TRACKED}
    return {"fit": rig["verdict"], "text": rig["text"]}
