"""TartanAir, both versions: one trajectory with images of a left and a right camera, and perhaps poses; no stamps.

All its cameras are alike, and parallel. Poses are of the camera, but in axes x forward, y right, z down.
"""

from os.path import isdir
from pathlib import Path

import numpy as np

from ..camera.models import Camera
from ..camera.rig import StereoRig
from ..errors import LogError
from ..geometry import se3
from .image_files import ImageFilesSource, size_of
from .image_folders import open_images
from .pose_files import read_rows

_SIDES = (("image_left", "image_right", "pose_left.txt"),
          ("image_lcam_front", "image_rcam_front", "pose_lcam_front.txt"))  # fmt: skip
_F_PX, _BASELINE_M = 320.0, 0.25
# Columns: the camera's right, down and forward in the axes of the poses.
_BODY_FROM_CAM = se3.from_rotation_translation([[0, 0, 1], [1, 0, 0], [0, 1, 0]], [0, 0, 0])


def is_tartanair(folder: Path) -> bool:
    """Whether a folder is laid out like a trajectory of TartanAir."""
    return _layout(folder) is not None


def open_tartanair(folder: Path) -> ImageFilesSource:
    """The trajectory in `folder`. Raises LogError."""
    layout = _layout(folder)
    if layout is None:
        raise LogError(
            f"{folder} holds no image_left and image_right: give the folder of a trajectory, such as P001"
        )
    source = open_images(str(folder / layout[0]), str(folder / layout[1]), None, path=folder)
    width, height = size_of(source.images[0][0].path)
    camera = Camera(width, height, np.array([[_F_PX, 0, width / 2], [0, _F_PX, height / 2], [0, 0, 1]]), (), "none")
    rig = StereoRig(camera, camera, se3.exp([-_BASELINE_M, 0, 0, 0, 0, 0]))
    poses, stamps = folder / layout[2], [image.stamp_ns for image in source.images[0]]
    truth = []
    if poses.is_file():
        rows = read_rows(poses, 7, "`x y z qx qy qz qw`")
        if len(rows) != len(stamps):
            raise LogError(f"{poses} has {len(rows)} poses for {len(stamps)} images: fetch both of one trajectory")
        rotations = se3.matrix_from_quat_xyzw(rows[:, 3:])
        world_from_cam = se3.from_rotation_translation(rotations, rows[:, :3]) @ _BODY_FROM_CAM
        truth = list(zip(stamps, se3.inverse(_BODY_FROM_CAM) @ world_from_cam, strict=True))
    return ImageFilesSource(folder, "TartanAir", rig, source.images, truth, source.notes)


def _layout(folder: Path) -> tuple[str, str, str] | None:
    return next((names for names in _SIDES if all(isdir(folder / name) for name in names[:2])), None)
