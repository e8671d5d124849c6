"""The stereo rig from two calibration messages, in the ROS sense of K, D, R and P.

P belongs to the rectified images: P[3] = −f·baseline for the right camera. R turns camera axes into rectified
axes. So a point X of the left camera is in the right one R_rᵀ (R_l X + t) with t = (Tx, Ty, 0), Tx = P[3]/P[0].
Images that are rectified already (by the name of their topic) are pinholes with P and neither D nor R.
"""

from pathlib import Path

import numpy as np

from ..errors import ConfigError, LogError
from ..geometry import pose as se3
from ..geometry.pose import Array
from ..types import Camera, StereoRig
from .messages import CalibrationMessage

_MODELS = {
    "": "plumb_bob", "plumb_bob": "plumb_bob", "radtan": "plumb_bob", "brown_conrady": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "equidistant": "equidistant", "kannala_brandt": "equidistant", "fisheye": "equidistant", "none": "none",
}  # fmt: skip
_CURE = "give the calibration with --calibration FILE"


def rig_from_messages(
    path: Path, left: CalibrationMessage, right: CalibrationMessage, rectified: bool
) -> StereoRig:
    """The rig; raises LogError naming the file, the topic and what to do."""
    for message in (left, right):
        if not message.P[0, 0] > 0 or not message.P[1, 1] > 0:
            raise LogError(
                f"{path}: topic {message.topic} has no projection matrix P, which holds the baseline; {_CURE}"
            )
    offset = _offset(right) - _offset(left)
    try:
        if rectified:
            right_from_left = se3.from_rotation_translation(np.eye(3), offset)
        else:
            r_left, r_right = _rotation(path, left), _rotation(path, right)
            right_from_left = se3.from_rotation_translation(r_right.T @ r_left, r_right.T @ offset)
        rig = StereoRig(_camera(path, left, rectified), _camera(path, right, rectified), right_from_left)
    except ConfigError as error:
        raise LogError(f"{path}: topics {left.topic} and {right.topic}: {error}; or {_CURE}") from None
    check_sides(path, rig)
    return rig


def check_sides(path: Path, rig: StereoRig) -> None:
    """Raises LogError where the right camera stands to the left of the left one."""
    x, y, _ = se3.inverse(rig.right_from_left)[:3, 3]
    if x < 0 and abs(x) > abs(y):
        raise LogError(
            f"{path}: by its calibration the right camera stands {-x:.4g} m to the left of the left one: left and "
            f"right are swapped (swap them with --left and --right), or the sign of P[3] is wrong; {_CURE}"
        )


def _offset(message: CalibrationMessage) -> Array:
    return np.array([message.P[0, 3] / message.P[0, 0], message.P[1, 3] / message.P[1, 1], 0.0])


def _rotation(path: Path, message: CalibrationMessage) -> Array:
    if not message.R.any():
        return np.eye(3)
    if not np.allclose(message.R @ message.R.T, np.eye(3), atol=1e-3) or np.linalg.det(message.R) < 0:
        raise LogError(f"{path}: topic {message.topic}: R is no rotation matrix: {message.R.tolist()}; {_CURE}")
    pose: Array = se3.orthonormalised(se3.from_rotation_translation(message.R, np.zeros(3)))
    return pose[:3, :3]


def _camera(path: Path, message: CalibrationMessage, rectified: bool) -> Camera:
    if rectified:
        return Camera(message.width, message.height, message.P[:3, :3], (), "none")
    if not any(message.D):
        return Camera(message.width, message.height, message.K, (), "none")
    model, coefficients = _MODELS.get(message.distortion_model), message.D
    if model == "plumb_bob" and len(coefficients) > 5:
        model = "rational_polynomial"  # some drivers send eight coefficients under the older name
    if model == "rational_polynomial":
        if any(coefficients[8:]):
            raise LogError(
                f"{path}: topic {message.topic}: {len(coefficients)} distortion coefficients (thin prism or tilt) "
                "are not supported, only the first eight of rational_polynomial; rectify the images first"
            )
        coefficients = (*coefficients, *[0.0] * 8)[:8]
    if model is None:
        raise LogError(
            f"{path}: topic {message.topic}: distortion model {message.distortion_model!r} is not known; known are "
            f"plumb_bob, rational_polynomial, equidistant (kannala_brandt); {_CURE}"
        )
    if model == "none":
        coefficients = ()
    return Camera(message.width, message.height, message.K, coefficients, model)
