"""The calibration error found in the images: as numbers, as a sentence, and as a picture over the image."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from ..camera.refinement import TERMS, disparity_rms_px
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import disparity_over_image
from ..rig_model.terms import DELAY, FOCAL, READOUT
from .svg import WIDTH

_SAMPLES = (5, 9)  # rows and columns of the places in the image over which errors are averaged
_CELLS = (3, 5)  # of the picture
_TELLING = 0.1  # relative error of a distance: the sentence says from which distance on it is exceeded
_CELL_HEIGHT = 40
_LEAST_SCALE_PX = 0.1  # error in the strongest colour, at least, so that negligible errors stay pale


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CalibrationError:
    """What the images have told about the calibration: `numbers` as the section `rig` of summary.json.

    `disparity_px` (rows, columns): the error of the disparity of far points over the left image, with `std_px`.
    """

    numbers: dict[str, Any]
    disparity_px: Array
    std_px: Array


def calibration_error(projection: StereoProjection, estimate: RigEstimate | None) -> CalibrationError | None:
    """The whole error of the given calibration, from an estimate in pixels; None where nothing is known."""
    if estimate is None:
        return None
    error_px, std_px = disparity_over_image(projection, estimate, _CELLS)
    return CalibrationError(describe(projection, estimate), error_px, std_px)


def describe(projection: StereoProjection, estimate: RigEstimate) -> dict[str, Any]:
    """The section `rig` of summary.json: errors of the calibration, and what they mean."""
    error_px, std_px = disparity_over_image(projection, estimate, _SAMPLES)
    refined, rms_px = estimate.refined, float(np.sqrt((error_px**2).mean()))
    if estimate.applied and refined is not None:
        text = (
            f"refined by {disparity_rms_px(refined):.2f} px of disparity, and corrected by "
            f"{disparity_rms_px(estimate.mean - refined):.2f} px more, as these images show"
        )
    elif estimate.applied:
        far_m = _TELLING * projection.f_px * projection.baseline_m / max(rms_px, 1e-9)
        text = (
            f"wrong by {rms_px:.2f} px of disparity, which is corrected: without that, distances beyond {far_m:.3g} m "
            "would be off by 10 % and more"
        )
    else:
        within_px = float(np.hypot(error_px, std_px).max())  # anywhere in the image
        text = f"agrees with the images; the disparity is right within {within_px:.2f} px"
        if refined is not None:
            text = (
                f"refined by {rms_px:.2f} px of disparity, with which the images agree; "
                f"right within {within_px:.2f} px"
            )
    text = "; ".join([text, *estimate.findings()])
    return {
        "applied": estimate.applied,
        "probability_wrong": estimate.p_wrong,
        "terms": list(TERMS),
        "error_px": estimate.mean[: len(TERMS)].tolist(),
        "std_px": np.sqrt(np.diag(estimate.cov))[: len(TERMS)].tolist(),
        "delay_s": estimate.term(DELAY),
        "readout_s": estimate.term(READOUT),
        "focal_length": estimate.term(FOCAL),
        "disparity_rms_px": rms_px,
        "text": text,
    }


def picture(calibration: CalibrationError | None) -> Markup:
    """The left image in cells, coloured by sign and size of the error; empty where nothing is known."""
    if calibration is None:
        return Markup("")
    rows, columns = calibration.disparity_px.shape
    strongest_px = max(float(np.abs(calibration.disparity_px).max()), _LEAST_SCALE_PX)
    w, h = 2 * WIDTH / columns, _CELL_HEIGHT
    cells = []
    for row in range(rows):
        for column in range(columns):
            error_px, std_px = calibration.disparity_px[row, column], calibration.std_px[row, column]
            sign = "more" if error_px > 0 else "less"
            x, y = column * w, row * h
            text = f"{error_px:+.2f} ± {std_px:.2f}".replace("-", "−")
            cells.append(
                f'<rect class="f-{sign}" x="{x:.1f}" y="{y}" width="{w:.1f}" height="{h}" '
                f'style="fill-opacity:{0.75 * abs(error_px) / strongest_px:.2f}"/>'
                f'<text class="tick mid figure" x="{x + w / 2:.1f}" y="{y + h / 2 + 4:.0f}">{text}</text>'
            )
    return Markup(
        '<figure class="wide"><figcaption><b>Error of the disparity</b> '
        "<span>of the given calibration, over the left image, px</span></figcaption>"
        '<svg viewBox="0 0 {} {}" role="img">{}</svg></figure>'
    ).format(2 * WIDTH, rows * h, Markup("".join(cells)))
