"""Parts of pages: the unit of lengths, what is told of a calibration, the picture of a view."""

import numpy as np
import pytest

from stream_sfm.camera.models import Camera
from stream_sfm.config import RigConfig
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.report.calibration_field import CalibrationError, calibration_error, cells
from stream_sfm.report.lengths import METRES, MILLIMETRES, unit_for
from stream_sfm.report.view import View
from stream_sfm.rig_model.estimate import RigEstimate
from stream_sfm.rig_model.model import RigModel
from stream_sfm.types import FrameEstimate, Status, StereoFrame


def test_small_lengths_are_in_millimetres() -> None:
    assert unit_for([0.001, np.nan, -0.9], None, np.zeros((2, 2))) == MILLIMETRES
    assert unit_for([0.001], [-1.5]) == METRES
    assert unit_for() == unit_for([np.nan]) == MILLIMETRES


def test_each_part_of_the_image_has_its_error_with_sigma() -> None:
    error_px = np.array([[0.21, -0.4, 0.0], [0.1, -0.2, 0.3]])
    shown = cells(CalibrationError({}, error_px, np.full((2, 3), 0.05)))
    assert [text for text, _, _ in shown[0]] == ["+0.21 ± 0.05", "−0.40 ± 0.05", "+0.00 ± 0.05"]
    assert [sign for _, sign, _ in shown[1]] == ["more", "less", "more"]


def test_a_refined_calibration_is_told_whole() -> None:
    """Nothing is left to correct after a refinement; what is told is what the given calibration has wrong."""
    projection = StereoProjection(
        f_px=300.0, cx_left_px=160.0, cx_right_px=160.0, cy_px=120.0, baseline_m=0.1, width=320, height=240
    )
    n = len(RigModel.of(projection, RigConfig()))
    mean, cov = np.zeros(n), 1e-4 * np.eye(n)
    mean[0] = 0.25  # the right image is too far right: less disparity
    found = calibration_error(projection, RigEstimate(mean, cov, 1.0, mean, cov, np.ones(n), refined=mean))
    assert found is not None and found.disparity_px == pytest.approx(-0.25, abs=1e-9)
    assert "refined by 0.25 px of disparity" in found.numbers["text"]
    assert calibration_error(projection, None) is None


def test_the_view_is_of_the_second_half_and_shows_where_points_came_from() -> None:
    """A point on the optical axis moves right by ten pixels; one behind the camera is not shown."""
    view = View(Camera(64, 48, np.array([[50.0, 0, 32], [0, 50.0, 24], [0, 0, 1]])))
    assert not view.figure()
    for k in range(7):
        points = np.array([[0.2 * k, 0.0, 1.0], [0.0, 0.0, -1.0]])
        local = (np.array([7, 8]), points, np.zeros((2, 3, 3)), points, np.zeros((2, 3, 3)))
        window, about = (np.empty(0, np.int64), np.empty((0, 4, 4))), {"counts": {}, "timings_ms": {}}
        estimate = FrameEstimate(
            Status.OK, "", np.eye(4), np.eye(6), *local, *window, frame_index=k, stamp_ns=k, **about
        )
        view.write(estimate, StereoFrame(k, np.full((48, 64), 9 * k, np.uint8), np.zeros((48, 64), np.uint8)))
    figure = str(view.figure())
    assert "left image of frame 4: 1 points" in figure
    assert 'd="M62.0 24.0L72.0 24.0"' in figure  # 50 px · 0.6 and 0.8, from the middle
