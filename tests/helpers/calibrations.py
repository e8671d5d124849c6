"""A rig as tools write it, and helpers for their files."""

import cv2
import numpy as np

from stream_sfm import Camera, MonoRig, StereoRig
from stream_sfm.geometry import se3
from tests.helpers.data_sets import kalibr
from tests.helpers.stereo_logs import calibration_of

RNG = np.random.default_rng(8)
SIZE = (752, 480)
LEFT = Camera(*SIZE, np.array([[458.654, 0, 367.215], [0, 457.296, 248.375], [0, 0, 1]]), (-0.28, 0.07, 2e-4, 1.8e-5))
RIGHT = Camera(*SIZE, np.array([[457.587, 0, 379.999], [0, 456.134, 255.238], [0, 0, 1]]), (-0.28, 0.08, 1e-4, -3e-5))
POSE = se3.from_rotation_translation(se3.exp_so3(np.array([0.002, 0.014, -0.0007])), np.array([-0.11, 4e-4, -8e-4]))
RIG, BOTH = StereoRig(LEFT, RIGHT, POSE), (LEFT, RIGHT)
KALIBR = kalibr(BOTH, POSE)
BODY_FROM_LEFT = se3.exp(RNG.normal(size=6) * 0.3)


OF_ROS = calibration_of(RIG, "plumb_bob")  # with R and P


def camera_info(calib, p=None):
    def matrix(key, m, shape):
        return f"{key}:\n  rows: {shape[0]}\n  cols: {shape[1]}\n  data: {np.ravel(m).tolist()}\n"

    return (
        f"image_width: {calib.width}\nimage_height: {calib.height}\ncamera_name: stereo\n"
        + matrix("camera_matrix", calib.K, (3, 3))
        + f"distortion_model: {calib.model}\n"
        + matrix("distortion_coefficients", [*calib.D, 0.0], (1, 5))
        + matrix("rectification_matrix", calib.R, (3, 3))
        + matrix("projection_matrix", calib.P if p is None else p, (3, 4))
    )


def storage(path, **values):
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        file.write(name, value)
    file.release()
    return path


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def check(where, rig=RIG, size=None, atol=1e-9):
    found = StereoRig.from_calibration(where, size)
    np.testing.assert_allclose(found.right_from_left, rig.right_from_left, atol=atol)
    for one, other in ((found.left, rig.left), (found.right, rig.right)):
        np.testing.assert_allclose(one.K, other.K, atol=1e-9)
        assert (one.width, one.height, one.distortion_model) == (other.width, other.height, other.distortion_model)
        np.testing.assert_allclose(one.D[:4], other.D[:4], atol=1e-12)
    left = MonoRig.from_calibration(where, size)
    np.testing.assert_allclose(left.left.K, rig.left.K, atol=1e-9)


TOML = """
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
