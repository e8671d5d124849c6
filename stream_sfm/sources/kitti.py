"""KITTI: one sequence of its odometry, or one rectified drive of its raw data, with the grey or the colour cameras.

Poses are camera 0 in the world; with the colour cameras they are carried into camera 2, the left one then.
"""

from os.path import isdir
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..camera.calibration import kitti
from ..camera.calibration.document import load
from ..camera.rig import StereoRig
from ..errors import ConfigError, LogError
from ..geometry import se3
from ..geometry.se3 import Array
from .image_files import ImageFile, ImageFilesSource, size_of
from .pose_files import read_kitti, read_times
from .text_files import check_ascending, read_text

_PAIRS = ((0, 1), (2, 3))  # grey, colour


class _Layout(NamedTuple):
    """Where things are: images of camera n, the stamps of its images, the calibration."""

    name: str
    images: str
    stamps: str
    calibrations: tuple[str, ...]


_LAYOUTS = (
    _Layout("KITTI odometry", "image_{}", "times.txt", ("calib.txt",)),
    _Layout("KITTI raw", "image_0{}/data", "image_0{}/timestamps.txt",
            ("calib_cam_to_cam.txt", "../calib_cam_to_cam.txt")),
)  # fmt: skip


def is_kitti(folder: Path) -> bool:
    """Whether a folder is laid out like a sequence of KITTI odometry, or like a rectified drive of its raw data."""
    found = _found(folder)
    return found is not None and found[2] is not None


def open_kitti(folder: Path, poses: str | Path | None = None) -> ImageFilesSource:
    """The sequence in `folder`. Raises LogError; ConfigError for the calibration.

    `poses`: ground truth, 12 numbers per line; without it `poses.txt` in the folder and the data set's own place
    (`../../poses/NN.txt`) are looked at.
    """
    found = _found(folder)
    if found is None:
        raise LogError(
            f"{folder} holds neither image_0 and image_1 nor image_2 and image_3: give the folder of one KITTI "
            "odometry sequence, such as dataset/sequences/00, or of one drive of its raw data (…_sync)"
        )
    layout, cameras, calibration = found
    if calibration is None:
        raise LogError(f"{folder} has no {layout.calibrations[0]}: it is a part of the data set")
    folders = [folder / layout.images.format(i) for i in cameras]
    files = [sorted(inside.glob("*.png")) for inside in folders]
    if not files[0] or not files[1]:
        raise LogError(f"{folder}: {folders[0].name} and {folders[1].name} must hold .png images")
    stamps = _stamps(folder / layout.stamps.format(cameras[0]))  # both cameras are triggered together
    left, right = ([ImageFile(_stamp(f, stamps), f) for f in side] for side in files)
    rig, cam0_from_left = _rig(calibration, cameras, size_of(files[0][0]))
    truth, notes = _truth(folder, poses, stamps, cam0_from_left)
    return ImageFilesSource(folder, layout.name, rig, (left, right), truth, notes)


def _found(folder: Path) -> tuple[_Layout, tuple[int, int], Path | None] | None:
    """The layout of a folder, its cameras and its calibration."""
    for layout in _LAYOUTS:
        for cameras in _PAIRS:
            # `isdir`, as that of a Path raises OSError where a name is too long
            if all(isdir(folder / layout.images.format(i)) for i in cameras):
                places = (folder / name for name in layout.calibrations)
                return layout, cameras, next((path for path in places if path.is_file()), None)
    return None


def _stamps(path: Path) -> list[int]:
    """The stamps of a file, ascending: seconds, or dates with nanoseconds as in the raw data."""
    if path.name == "times.txt":
        return read_times(path)
    stamps = []
    for number, line in enumerate(read_text(path, "times").split("\n"), start=1):
        if line.strip():
            try:
                stamps.append(int(np.datetime64(line.strip().replace(" ", "T"), "ns").astype(np.int64)))
            except ValueError:
                raise LogError(f"{path}, line {number} is not a date: {line.strip()!r}") from None
    check_ascending(stamps, path)
    return stamps


def _stamp(file: Path, stamps: list[int]) -> int:
    """The stamp of an image: its name is the number of its line among the stamps."""
    if not file.stem.isdecimal() or int(file.stem) >= len(stamps):
        raise LogError(f"{file}: the name is not the number of a line of the times, which are {len(stamps)}")
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
