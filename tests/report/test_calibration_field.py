"""The picture of the calibration's error."""

import re

import numpy as np

from stream_sfm.report.calibration_field import picture
from stream_sfm.report.records import CalibrationError


def test_each_part_of_the_image_has_its_error_with_sigma() -> None:
    error_px = np.array([[0.21, -0.4, 0.0], [0.1, -0.2, 0.3]])
    text = str(picture(CalibrationError({}, error_px, np.full((2, 3), 0.05))))
    shown = re.findall(r">([+−][0-9.]+) ± 0.05<", text)
    assert [float(x.replace("−", "-")) for x in shown] == error_px.ravel().tolist()
    opacity = [float(x) for x in re.findall(r"fill-opacity:([0-9.]+)", text)]
    assert np.argsort(opacity).tolist() == np.argsort(np.abs(error_px).ravel()).tolist()
    assert text.count("f-less") == 3 and text.count("f-more") == 3


def test_nothing_is_drawn_where_nothing_is_known() -> None:
    assert not picture(None)


def test_small_errors_are_pale() -> None:
    text = str(picture(CalibrationError({}, np.full((1, 1), 0.001), np.full((1, 1), 0.002))))
    assert float(re.findall(r"fill-opacity:([0-9.]+)", text)[0]) < 0.02
