"""The calibration error found in the images: as numbers, as a sentence, and as a picture over the image."""

from typing import Any

import numpy as np

from ..camera.refinement import TERMS, disparity_rms_px
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..record import record
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import disparity_over_image
from ..rig_model.terms import DELAY, FOCAL, READOUT

_SAMPLES = (5, 9)  # rows and columns of the places in the image over which errors are averaged
_CELLS = (3, 5)  # of the picture
_TELLING = 0.1  # relative error of a distance: the sentence says from which distance on it is exceeded
_LEAST_SCALE_PX = 0.1  # error in the strongest colour, at least, so that negligible errors stay pale


@record
class CalibrationError:
    """What the images have shown about the calibration: `numbers` as the section `rig` of summary.json.

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


def cells(calibration: CalibrationError) -> list[list[tuple[str, str, float]]]:
    """The left image in cells: the error with its σ as text, the class of its sign, and how strong its colour is."""
    error_px, std_px = calibration.disparity_px, calibration.std_px
    strongest_px = max(float(np.abs(error_px).max()), _LEAST_SCALE_PX)
    return [
        [
            (f"{e:+.2f} ± {s:.2f}".replace("-", "−"), "more" if e > 0 else "less", 0.75 * abs(e) / strongest_px)
            for e, s in zip(*row, strict=True)
        ]
        for row in zip(error_px.tolist(), std_px.tolist(), strict=True)
    ]
