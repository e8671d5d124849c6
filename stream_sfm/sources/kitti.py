"""KITTI odometry: one sequence folder with calib.txt, times.txt, image_0 and image_1 (or image_2 and image_3).

Poses are camera 0 in the world; with the colour cameras they are carried into camera 2, the left one then.
"""

from os.path import isdir
from pathlib import Path

import numpy as np

from ..camera.calibration import kitti
from ..camera.calibration.document import load
from ..camera.rig import StereoRig
from ..errors import ConfigError, LogError
from ..geometry import se3
from ..geometry.se3 import Array
from .image_files import ImageFile, ImageFilesSource, size_of
from .pose_files import read_kitti, read_times
from .text_files import read_text

_PAIRS = ((0, 1), (2, 3))  # grey, colour


def is_kitti(folder: Path) -> bool:
    """Whether a folder is laid out like a sequence of KITTI odometry."""
    return _cameras(folder) is not None and (folder / "calib.txt").is_file()


def open_kitti(folder: Path, poses: str | Path | None = None) -> ImageFilesSource:
    """The sequence in `folder`. Raises LogError; ConfigError for the calibration.

    `poses`: ground truth, 12 numbers per line; without it `poses.txt` in the folder and the data set's own place
    (`../../poses/NN.txt`) are looked at.
    """
    cameras = _cameras(folder)
    if cameras is None:
        raise LogError(
            f"{folder} holds neither image_0 and image_1 nor image_2 and image_3: give the folder of one KITTI "
            "odometry sequence, such as dataset/sequences/00"
        )
    stamps = read_times(folder / "times.txt")
    files = [sorted((folder / f"image_{i}").glob("*.png")) for i in cameras]
    if not files[0] or not files[1]:
        raise LogError(f"{folder}: image_{cameras[0]} and image_{cameras[1]} must hold .png images")
    left, right = ([ImageFile(_stamp(f, stamps), f) for f in side] for side in files)
    rig, cam0_from_left = _rig(folder / "calib.txt", cameras, size_of(files[0][0]))
    truth, notes = _truth(folder, poses, stamps, cam0_from_left)
    return ImageFilesSource(folder, "KITTI odometry", rig, (left, right), truth, notes)


def _cameras(folder: Path) -> tuple[int, int] | None:
    # `isdir`, as that of a Path raises OSError where a name is too long
    return next((c for c in _PAIRS if all(isdir(folder / f"image_{i}") for i in c)), None)


def _stamp(file: Path, stamps: list[int]) -> int:
    """The stamp of an image: its name is the number of its line in times.txt."""
    if not file.stem.isdecimal() or int(file.stem) >= len(stamps):
        raise LogError(f"{file}: the name is not the number of a line in times.txt, which has {len(stamps)} lines")
    return stamps[int(file.stem)]


def _rig(path: Path, cameras: tuple[int, int], size: tuple[int, int]) -> tuple[StereoRig, Array]:
    document = load(read_text(path, "calibration").encode(), path)
    pair = kitti.pair_of(document, cameras, size)
    cam0_from_left = se3.from_rotation_translation(np.eye(3), -kitti.cam_from_cam0(document, cameras[0]))
    try:
        return StereoRig(*pair), np.asarray(cam0_from_left)
    except ConfigError as error:
        raise document.error(str(error)) from None


def _truth(
    folder: Path, poses: str | Path | None, stamps: list[int], cam0_from_left: Array
) -> tuple[list[tuple[int, Array]], list[str]]:
    """(stamp_ns, world_from_left) of the ground truth, and what to know about it."""
    path = Path(poses) if poses is not None else _poses_file(folder)
    if path is None:
        return [], []
    world_from_cam0 = read_kitti(path)
    if len(world_from_cam0) > len(stamps):
        raise LogError(f"{path} has {len(world_from_cam0)} poses for {len(stamps)} times in {folder}")
    notes = []
    if len(world_from_cam0) < len(stamps):
        notes.append(f"{path} has poses for the first {len(world_from_cam0)} of {len(stamps)} frames")
    return list(zip(stamps, world_from_cam0 @ cam0_from_left, strict=False)), notes


def _poses_file(folder: Path) -> Path | None:
    resolved = folder.resolve()
    places = (folder / "poses.txt", resolved.parent.parent / "poses" / f"{resolved.name}.txt")
    return next((p for p in places if p.is_file()), None)
