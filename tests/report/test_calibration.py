"""What is told of a calibration."""

import numpy as np
import pytest

from stream_sfm.config import RigConfig
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.report.calibration import describe
from stream_sfm.rig_model.estimate import RigEstimate
from stream_sfm.rig_model.model import RigModel


def test_a_refined_calibration_is_told_whole() -> None:
    """Nothing is left to correct after a refinement; what is told is what the given calibration has wrong."""
    projection = StereoProjection(
        f_px=300.0, cx_left_px=160.0, cx_right_px=160.0, cy_px=120.0, baseline_m=0.1, width=320, height=240
    )
    n = len(RigModel.of(projection, RigConfig()))
    mean, cov = np.zeros(n), 1e-4 * np.eye(n)
    mean[0] = 0.25  # the right image is too far right: less disparity
    found = describe(projection, RigEstimate(mean, cov, 1.0, mean, cov, np.ones(n), refined=mean))
    assert found["disparity_rms_px"] == pytest.approx(0.25, abs=1e-9)
    assert found["text"].startswith("refined by 0.25 px of disparity")
