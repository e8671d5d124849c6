"""Calibration files: there and back, and every mistake named with file and key."""

import numpy as np
import pytest

from stream_sfm import Camera, ConfigError, StereoRig

GOOD = """
[left]
width = 640
height = 480
fx = 500.0
fy = 501.0
cx = 320
cy = 240.5
[right]
width = 640
height = 480
K = [[500.0, 0, 321], [0, 500, 240], [0, 0, 1]]
distortion_model = "plumb_bob"
D = [-0.2, 0.03, 0.0, 0.001]
[right_from_left]
translation_m = [-0.12, 0.0, 0.0]
"""


def test_both_forms_are_read(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(GOOD)
    rig = StereoRig.from_calibration(path)
    assert rig.baseline_m == pytest.approx(0.12)
    np.testing.assert_array_equal(rig.left.K, [[500, 0, 320], [0, 501, 240.5], [0, 0, 1]])
    assert rig.left.distortion_model == "none" and rig.right.D == (-0.2, 0.03, 0.0, 0.001)
    matrix = "right_from_left = [[1, 0, 0, -0.12], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]\n"
    path.write_text(matrix + GOOD.split("[right_from_left]")[0])
    np.testing.assert_array_equal(StereoRig.from_calibration(path).right_from_left, rig.right_from_left)


def test_there_and_back(tmp_path):
    path = tmp_path / "rig.toml"
    c, s = np.cos(0.05), np.sin(0.05)
    pose = np.array([[c, 0, s, -0.2], [0, 1, 0, 0.01], [-s, 0, c, 0.003], [0, 0, 0, 1]])
    k = np.array([[458.654, 0, 367.215], [0, 457.296, 248.375], [0, 0, 1]])
    rig = StereoRig(Camera(752, 480, k, (0.1, 0.2, 0.3, 0.4), "equidistant"), Camera(752, 480, k), pose)
    path.write_text(rig.to_toml())
    again = StereoRig.from_calibration(path)
    np.testing.assert_allclose(again.right_from_left, rig.right_from_left, atol=1e-15)
    np.testing.assert_array_equal(again.left.K, k)
    assert (again.left.D, again.left.distortion_model) == (rig.left.D, "equidistant")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[left]", "[lefty]", ["'lefty'"]),
        ("width = 640\nheight = 480\nfx", "height = 480\nfx", ["left.width", "whole number"]),
        ("fx = 500.0", "fx = '500'", ["left.fx", "a number"]),
        ("fx = 500.0", "", ["left.fx"]),
        ("fx = 500.0", "fx = nan", ["left.fx", "finite"]),
        ("fx = 500.0", "focal = 500.0", ["'focal'", "[left]"]),
        ("fx = 500.0", "fx = 500.0\nK = [[1]]", ["either K or fx"]),
        ("K = [[500.0, 0, 321], [0, 500, 240], [0, 0, 1]]", "K = [[500.0, 0], [0]]", ["right.K", "3×3"]),
        ("D = [-0.2, 0.03, 0.0, 0.001]", "D = [1.0, 2.0]", ["right", "coefficients"]),
        ('"plumb_bob"', '"mei"', ["right", "'mei'"]),
        ("translation_m = [-0.12, 0.0, 0.0]", "translation = [-0.12, 0.0, 0.0]", ["'translation'"]),
        ("translation_m = [-0.12, 0.0, 0.0]", "", ["translation_m", "3 numbers"]),
        ("translation_m = [-0.12, 0.0, 0.0]", "translation_m = [0, 0, 0]", ["baseline"]),
        ("[right_from_left]\ntranslation_m = [-0.12, 0.0, 0.0]", "", ["right_from_left is missing"]),
        ("[left]", "[left", ["not TOML"]),
    ],
)
def test_mistakes_are_named(tmp_path, old, new, words):
    path = tmp_path / "rig.toml"
    assert old in GOOD
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        StereoRig.from_calibration(path)
    for word in (*words, str(path)):
        assert word in str(caught.value)
