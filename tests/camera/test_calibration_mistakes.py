"""Each mistake in a calibration is named with its file."""

import numpy as np
import pytest

from stream_sfm import ConfigError, StereoRig
from stream_sfm.camera.calibration.document import make_camera
from tests.helpers.calibrations import BOTH, KALIBR, OF_ROS, POSE, TOML, camera_info, write
from tests.helpers.data_sets import kalibr

BROKEN = {
    "no rotation": (KALIBR.replace(repr(float(POSE[0, 0])), "3.5"), "T_cn_cnm1 is not a rotation"),
    "model": (KALIBR.replace("pinhole", "fov", 1), "cam0.camera_model 'fov' is not supported"),
    "lens": (kalibr(BOTH, POSE, lens="fov"), "distortion model 'fov' is not supported; supported are .*radtan"),
    "one camera": (KALIBR.split("cam1:")[0], "cam1 is missing"),
    "no chain": (KALIBR.split("  T_cn_cnm1")[0], "cam1.T_cn_cnm1.* is missing"),
    "no number": (KALIBR.replace("752", "wide", 1), "cam0.resolution must be 2 numbers"),
    "YAML": ("cam0: [1, 2", "neither TOML nor YAML"),
    "a list": ("- 1\n- 2\n", "has no keys"),
    "other keys": ("fx: 1\nfy: 2\n", "of no known format; known are TOML.*Kalibr.*ROS.*EuRoC.*KITTI.*OpenCV"),
    "empty": ("", "has no keys"),
    "storage": ("%YAML:1.0\nM1: !!opencv-matrix\n  rows: [", "OpenCV's FileStorage"),
}  # fmt: skip
OF_TOML = [  # what is changed, to what, and what the error says
    ("[left]", "[lefty]", "'lefty'"),
    ("width = 640\nheight = 480\nfx", "height = 480\nfx", "left.width .*whole number"),
    ("fx = 500.0", "fx = '500'", "left.fx .*a number"),
    ("fx = 500.0", "", "left.fx"),
    ("fx = 500.0", "fx = nan", "left.fx .*finite"),
    ("fx = 500.0", "focal = 500.0", r"'focal' at \[left\]"),
    ("fx = 500.0", "fx = 500.0\nK = [[1]]", "either K or fx"),
    ("K = [[500.0, 0, 321], [0, 500, 240], [0, 0, 1]]", "K = [[500.0, 0], [0]]", "right.K .*3×3"),
    ("D = [-0.2, 0.03, 0.0, 0.001]", "D = [1.0, 2.0]", "right: .*coefficients"),
    ('"plumb_bob"', '"mei"', "right: .*'mei'"),
    ("translation_m = [-0.12, 0.0, 0.0]", "translation = [-0.12, 0.0, 0.0]", "'translation'"),
    ("translation_m = [-0.12, 0.0, 0.0]", "", "translation_m .*3 numbers"),
    ("translation_m = [-0.12, 0.0, 0.0]", "translation_m = [0, 0, 0]", "baseline"),
    ("[right_from_left]\ntranslation_m = [-0.12, 0.0, 0.0]", "", "right_from_left is missing"),
    ("[left]", "[left", "not TOML"),
]
assert all(old in TOML for old, _, _ in OF_TOML)
BROKEN |= {
    f"TOML: {new}" if new else f"TOML without {old}": (TOML.replace(old, new), words) for old, new, words in OF_TOML
}


@pytest.mark.parametrize("name", BROKEN)
def test_mistakes_are_named_with_the_file(tmp_path, name):
    text, words = BROKEN[name]
    path = write(tmp_path / "rig.yaml", text)
    with pytest.raises(ConfigError, match=words) as caught:
        StereoRig.from_calibration(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_two_formats_are_no_pair_and_a_folder_has_one(tmp_path):
    files = [write(tmp_path / "left.yaml", camera_info(OF_ROS[0])), write(tmp_path / "c.yaml", KALIBR)]
    with pytest.raises(ConfigError, match=r"this is a Kalibr.*left\.yaml is a ROS"):
        StereoRig.from_calibration(files)
    with pytest.raises(ConfigError, match=r"several calibrations \(c\.yaml, left\.yaml\)"):
        StereoRig.from_calibration(tmp_path)
    with pytest.raises(ConfigError, match="holds no calibration"):
        StereoRig.from_calibration(write(tmp_path / "empty" / "notes.txt", "nothing").parent)


@pytest.mark.parametrize("model", ["none", "None"])
def test_coefficients_of_no_model_are_not_dropped_in_silence(model):
    k = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
    with pytest.raises(ConfigError, match=r"'[nN]one' comes with the coefficients \[-0\.1, 0\.0\]: name the model"):
        make_camera((320, 240), k, model, (-0.1, 0.0))
    assert make_camera((320, 240), k, model, (0.0, 0.0)).distortion_model == "none"
