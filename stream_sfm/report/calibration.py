"""The calibration error found in the images, in numbers and in a sentence."""

from typing import Any

import numpy as np

from ..camera.refinement import LENS_TERMS, disparity_rms_px
from ..geometry.stereo import StereoProjection
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import disparity_over_image
from ..rig_model.terms import CAUSES


def describe(projection: StereoProjection, estimate: RigEstimate) -> dict[str, Any]:
    """Return the section `rig` of summary.json: errors of the given calibration, and what they mean."""
    error_px, std_px = disparity_over_image(projection, estimate, (5, 9))  # on a grid of places
    refined, rms_px = estimate.refined, float(np.sqrt((error_px**2).mean()))
    within_px = float(np.hypot(error_px, std_px).max())  # anywhere in the image
    if estimate.applied and refined is not None:
        text = (
            f"refined by {disparity_rms_px(refined):.2f} px of disparity, and corrected by a further "
            f"{disparity_rms_px(estimate.mean - refined):.2f} px for these images"
        )
    elif estimate.applied and not (estimate.agrees(LENS_TERMS) and rms_px > 0.005):  # less is printed as 0.00
        text = (
            f"corrected by {rms_px:.2f} px of disparity; the parts of the run do not yet agree on whether the "
            "calibration is wrong"
        )
    elif estimate.applied:
        telling = 0.1  # relative error of a distance
        far_m = telling * projection.f_px * projection.baseline_m / max(rms_px, 1e-9)
        text = (
            f"wrong by {rms_px:.2f} px of disparity, and corrected: otherwise distances beyond {far_m:.3g} m would be "
            f"wrong by {100 * telling:.0f} % or more"
        )
    elif refined is not None:
        text = f"refined by {rms_px:.2f} px of disparity, in agreement with the images; right within {within_px:.2f} px"
    else:
        text = f"agrees with the images; the disparity is right within {within_px:.2f} px"
    return {
        "applied": estimate.applied,
        "probability_wrong": estimate.p_wrong,
        "parts_agree": estimate.agrees(LENS_TERMS),
        "terms": list(LENS_TERMS),
        "error_px": estimate.mean[: len(LENS_TERMS)].tolist(),
        "std_px": np.sqrt(np.diag(estimate.cov))[: len(LENS_TERMS)].tolist(),
        **{group.key: estimate.group(group) for group in CAUSES},
        "disparity_rms_px": rms_px,
        "text": "; ".join([text, *estimate.findings()]),
    }
