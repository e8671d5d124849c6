"""Recordings of 4Seasons: rectified images, their calibration in three text files, poses and an inertial unit.

The calibration is a download of its own, and also has files of the raw images, which fit images of the same size.
"""

from pathlib import Path

import numpy as np

from ...camera.calibration.document import Document, camera_matrix
from ...camera.models import Camera
from ...camera.rig import StereoRig
from ...errors import ConfigError, LogError, as_error
from ...geometry import Array, se3
from ...inertial.samples import ImuCalibration
from .given import Given
from .image_files import ImageFilesSource
from .image_sets import open_images
from .pose_files import read_stamped, read_table, read_text, read_tum

SIDES = ("undistorted_images/cam0", "undistorted_images/cam1")
_CAMERAS = ("undistorted_calib_0.txt", "undistorted_calib_1.txt")
_POSE = "undistorted_calib_stereo.txt"
_PLACES = ("calibration", "Calibration", "calibration/calibration", ".")  # in the folder, and in two above it
_LEVELS = 3
_MOUNTING = "# TS_cam_imu"  # in Transformations.txt, above its line


def open_four_seasons(folder: Path, _layout: object, given: Given) -> ImageFilesSource:
    """Open a recording; the names of its images are stamps, and key frames have poses. Raises LogError, ConfigError."""
    source = open_images(str(folder / SIDES[0]), str(folder / SIDES[1]), None, path=folder)
    notes = list(source.notes)
    rig = None if given.calibrated else _rig(folder)
    poses = _poses(folder / "GNSSPoses.txt")
    return ImageFilesSource(folder, "4Seasons", rig, source.images, poses, notes, _imu(folder, notes))


def _rig(folder: Path) -> StereoRig:
    places = [above / name for above in [folder, *folder.absolute().parents][:_LEVELS] for name in _PLACES]
    found = next((place for place in places if (place / _POSE).is_file()), None)
    if found is None:
        problem = f"{folder} has no calibration: {_POSE} is in no folder `calibration` in it or beside it"
        raise ConfigError(f"{problem}: unpack that of the data set there", hint=("calibration",))
    left, right = (_camera(found / name) for name in _CAMERAS)
    matrix = Document(str(found / _POSE), {})
    # The data set says that it carries points of the right camera into the left one; its sign says the opposite.
    pose = matrix.pose(_lines(found / _POSE), "its content")
    with matrix.naming():
        return StereoRig(left, right, pose)


def _camera(path: Path) -> Camera:
    """Return a camera: `Pinhole fx fy cx cy 0 0 0 0`, and its size in the next line."""
    lines = _lines(path)
    with as_error(ConfigError, f"{path} is not `Pinhole fx fy cx cy 0 0 0 0` and a size", ValueError, IndexError):
        model, *numbers = lines[0]
        fx, fy, cx, cy, *lens = map(float, numbers)
        if model != "Pinhole" or any(lens):
            raise ValueError(" ".join(lines[0]))
        width, height = map(int, lines[1])
        return Camera(width, height, camera_matrix(fx, fy, cx, cy), (), "none")


def _lines(path: Path) -> list[list[str]]:
    with as_error(ConfigError, "", LogError):
        return [cells for _, cells in read_table(path, "calibration")]


def _poses(path: Path) -> list[tuple[int, Array]]:
    """Return stamps and poses of the left camera; each line has the scale of its position behind the quaternion."""
    if not path.is_file():
        return []
    poses, (_, rows) = read_tum(path), read_stamped(path, 8, "`stamp x y z qx qy qz qw scale`")
    world_from_cam = poses.world_from_cam.copy()
    world_from_cam[:, :3, 3] *= rows[:, 7:]
    return list(zip(poses.stamps_ns.tolist(), world_from_cam, strict=True))


def _imu(folder: Path, notes: list[str]) -> tuple[list[tuple[int, Array]], ImuCalibration] | None:
    """Return the samples of the inertial unit, and its mounting in the rectified left camera."""
    samples, mountings = folder / "imu.txt", folder / "Transformations.txt"
    if not samples.is_file():
        return None
    try:
        with as_error(LogError, f"{mountings} has no line of 7 numbers below {_MOUNTING}", ValueError, IndexError):
            lines = read_text(mountings, "transformations").split("\n")
            at = next((n for n, line in enumerate(lines) if line.startswith(_MOUNTING)), len(lines))
            x, y, z, *quaternion = map(float, lines[at + 1].split(","))
            rotation = se3.matrix_from_quat_xyzw(np.array(quaternion).reshape(4))
            unit = ImuCalibration(se3.from_rotation_translation(rotation, [x, y, z]))
        stamps, rows = read_stamped(samples, 6, "`stamp wx wy wz ax ay az`")
        return list(zip(stamps, rows, strict=True)), unit
    except (LogError, ConfigError) as error:
        notes.append(f"the IMU is not used: {error}")
        return None
