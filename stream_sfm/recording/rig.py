"""The stereo rig from two calibration messages, in the ROS sense of K, D, R and P.

What R and P say of the pose is in `camera/calibration/projections.py`. Images that are rectified (by the name of
their topic) are pinholes with P and neither D nor R. A pose of the right camera that comes from elsewhere takes the
place of R and P[3].
"""

from pathlib import Path

import numpy as np

from ..camera.calibration import projections
from ..camera.calibration.document import make_camera
from ..camera.models import Camera
from ..camera.rectification import check_rectifiable
from ..camera.rig import MonoRig, StereoRig, baseline_question
from ..errors import ConfigError, LogError, RigError
from ..geometry import se3
from ..geometry.se3 import Array
from .messages import CalibrationMessage

_ROTATION_TOLERANCE = 1e-3  # of R Rᵀ from the identity: matrices are sent with as few as four digits
REMEDY = "give the calibration of these cameras"


def calibration_error(problem: str, *hints: str) -> LogError:
    """The error of a calibration in a log that cannot be used: giving another one always helps."""
    return LogError(f"{problem}; {REMEDY}", hint=(*hints, "calibration"))


def gives_baseline(left: CalibrationMessage, right: CalibrationMessage) -> bool:
    """Whether P of both cameras is filled in and contains the baseline."""
    return projections.gives_baseline(left.P, right.P)


def rig_from_messages(
    path: Path,
    left: CalibrationMessage,
    right: CalibrationMessage,
    rectified: bool,
    right_from_left: Array | None = None,
) -> StereoRig:
    """The rig; its pose comes from R and P unless `right_from_left` (4, 4) is given.

    Raises LogError naming the file, the topic and what to do.
    """
    try:
        if right_from_left is None:
            r_left, r_right = (np.eye(3) if rectified else _rotation(path, m) for m in (left, right))
            right_from_left = projections.pose_from_projections(r_left, left.P, r_right, right.P)
        return StereoRig(_camera(path, left, rectified), _camera(path, right, rectified), right_from_left)
    except ConfigError as error:
        raise calibration_error(f"{path}: topics {left.topic} and {right.topic}: {error}") from None


def camera_from_message(path: Path, message: CalibrationMessage, rectified: bool) -> MonoRig:
    """The rig of the one camera of a message. Raises LogError as `rig_from_messages`."""
    try:
        return MonoRig(_camera(path, message, rectified))
    except ConfigError as error:
        raise calibration_error(f"{path}: topic {message.topic}: {error}") from None


def right_is_left(rig: StereoRig) -> float | None:
    """How far the right camera stands to the left of the left one, metres; None where it stands on its right."""
    x, y, _ = se3.inverse(rig.right_from_left)[:3, 3]
    return float(-x) if x < 0 and abs(x) > abs(y) else None


def baseline_warnings(rig: StereoRig | MonoRig) -> list[str]:
    """What is to be asked about a baseline, as a list of none or one."""
    question = baseline_question(rig)
    return [question] if question else []


def check_rig(path: Path, rig: StereoRig | MonoRig) -> None:
    """Raise LogError where the images of a log cannot be used with this rig, whatever they show."""
    if isinstance(rig, StereoRig):
        check_sides(path, rig)
    try:
        check_rectifiable(rig)
    except RigError as error:
        raise calibration_error(f"{path}: {error}", *error.hint) from None


def check_sides(path: Path, rig: StereoRig) -> None:
    """Raise LogError where the right camera stands to the left of the left one."""
    if (distance_m := right_is_left(rig)) is not None:
        raise calibration_error(
            f"{path}: by its calibration the right camera stands {distance_m:.4g} m to the left of the left one: "
            "left and right are swapped, or the sign of P[3] is wrong: exchange the topics, or correct the sign",
            "left",
            "right",
            "inspect",
        )


def _rotation(path: Path, message: CalibrationMessage) -> Array:
    if not message.R.any():
        return np.eye(3)
    orthogonal = np.allclose(message.R @ message.R.T, np.eye(3), atol=_ROTATION_TOLERANCE)
    if not orthogonal or np.linalg.det(message.R) < 0:
        raise calibration_error(f"{path}: topic {message.topic}: R is not a rotation matrix: {message.R.tolist()}")
    pose: Array = se3.orthonormalise(se3.from_rotation_translation(message.R, np.zeros(3)))
    return pose[:3, :3]


def _camera(path: Path, message: CalibrationMessage, rectified: bool) -> Camera:
    if rectified:
        k = message.P[:3, :3] if message.P[0, 0] > 0 else message.K
        return Camera(message.width, message.height, k, (), "none")
    size = (message.width, message.height)
    try:
        return make_camera(size, message.K, message.distortion_model, message.D)
    except ConfigError as error:
        raise calibration_error(f"{path}: topic {message.topic}: {error}") from None
