"""The calibration error found in the images, in numbers and in a sentence."""

from typing import Any

import numpy as np

from ..camera.refinement import LENS_TERMS
from ..frontend.learnt.rows import Rows
from ..geometry.stereo import StereoProjection
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import disparity_over_image
from ..rig_model.terms import CAUSES
from .verdict import verdict


def describe(projection: StereoProjection, estimate: RigEstimate, rows: Rows) -> dict[str, Any]:
    """Return the section `rig` of summary.json: errors of the given calibration, and what they mean.

    `rows`: those that the front-end has learnt.
    """
    error_px, _ = disparity_over_image(projection, estimate, (5, 9))  # on a grid of places
    found = verdict(projection, estimate, rows)
    return {
        "verdict": str(found.fit),
        "applied": estimate.applied,
        "probability_wrong": estimate.p_wrong,
        "parts_agree": estimate.agrees(LENS_TERMS),
        "terms": list(LENS_TERMS),
        "error_px": estimate.mean[: len(LENS_TERMS)].tolist(),
        "std_px": np.sqrt(np.diag(estimate.cov))[: len(LENS_TERMS)].tolist(),
        **{group.key: estimate.group(group) for group in CAUSES},
        "disparity_rms_px": float(np.sqrt((error_px**2).mean())),
        "rows_rms_px": rows.rms_px if np.isfinite(rows.rms_px) else None,
        "text": found.text,
    }
