"""What every importer shares: the calibration messages of a rig, sizes of image files, writing in order of time."""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..camera.models import Camera
from ..camera.rectification import Rectifier
from ..camera.rig import StereoRig
from ..errors import ConfigError, InputError
from ..geometry.se3 import Array
from ..recording.log_writer import StereoLogWriter
from ..recording.messages import CalibrationMessage
from ..sources.image_header import image_format, image_size

# the names of Foxglove's CameraCalibration
_MODELS = {
    "none": "plumb_bob",
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "equidistant": "kannala_brandt",
}


@dataclass(frozen=True, slots=True)
class Imported:
    """What was written: the number of images on each side, of ground-truth poses, and what to know about it."""

    path: Path
    left: int
    right: int
    poses: int
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class ImageFile:
    """An image on disk and its stamp."""

    stamp_ns: int
    path: Path


def write_images(
    out: str | Path,
    rig: StereoRig,
    images: tuple[Sequence[ImageFile], Sequence[ImageFile]],
    poses: Sequence[tuple[int, Array]] = (),
    warnings: Sequence[str] = (),
) -> Imported:
    """The log of left and right images and ground-truth poses (stamp_ns, world_from_cam), each ascending in time.

    Raises InputError where an image cannot be read or does not fit the calibration, OutputError.
    """
    warnings = list(warnings)
    stamps = [{i.stamp_ns for i in side} for side in images]
    if not stamps[0] & stamps[1]:
        raise InputError(
            f"{images[0][0].path.parent} and {images[1][0].path.parent}: no left and right image have the same "
            "stamp; are both folders of one recording?"
        )
    alone = len(stamps[0] ^ stamps[1])
    if alone:
        warnings.append(f"{alone} images have no partner of the same stamp on the other side")
    # merged by time; at one stamp the pose comes first, then left, then right
    events: Iterator[tuple[int, int, Path | Array]] = heapq.merge(
        ((s, 0, p) for s, p in poses),
        ((i.stamp_ns, 1, i.path) for i in images[0]),
        ((i.stamp_ns, 2, i.path) for i in images[1]),
        key=lambda event: event[:2],
    )
    with StereoLogWriter(out, calibration_messages(rig)) as log:
        for stamp_ns, kind, item in events:
            if isinstance(item, Path):
                data, encoding = read_image(item, rig.right if kind == 2 else rig.left)
                log.image(kind - 1, stamp_ns, data, encoding)
            else:
                log.pose(stamp_ns, item)
    return Imported(Path(out), len(images[0]), len(images[1]), len(poses), warnings)


def read_image(path: Path, camera: Camera | None = None) -> tuple[bytes, str]:
    """Bytes and format of an image file, of the camera's size if given. Raises InputError naming file and cure."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read image {path}: {error.strerror}") from None
    encoding = image_format(data)
    if encoding is None:
        raise InputError(f"{path} is no PNG, JPEG or WebP image: convert the images to PNG first")
    size = image_size(data)
    if size is None:
        raise InputError(f"{path}: the header of this image is damaged: fetch it again, or leave it out")
    if camera is not None and size != (camera.width, camera.height):
        raise InputError(
            f"{path} is {size[0]}×{size[1]}, the calibration is for {camera.width}×{camera.height}: give images "
            "of the calibrated size, or the calibration of these images"
        )
    return data, encoding


def size_of(path: Path) -> tuple[int, int]:
    """Width and height of an image file, pixels. Raises InputError."""
    data, _ = read_image(path)
    size = image_size(data)
    assert size is not None  # read_image has looked
    return size


def calibration_messages(rig: StereoRig) -> tuple[CalibrationMessage, CalibrationMessage]:
    """K, D, R, P of both cameras in the ROS sense; a reader gets the rig back from them.

    A pair that is rectified already (parallel, undistorted, one K) keeps R = 1 and P = K.
    """
    pose, k = rig.right_from_left, rig.left.K
    parallel = np.array_equal(pose[:3, :3], np.eye(3)) and not pose[1:3, 3].any() and pose[0, 3] < 0
    if parallel and np.array_equal(k, rig.right.K) and not any((*rig.left.D, *rig.right.D)):
        rotations = (np.eye(3), np.eye(3))
        projections = [np.c_[k, [x, 0, 0]] for x in (0.0, k[0, 0] * pose[0, 3])]
    else:
        rectifier = Rectifier(rig)
        p, r = rectifier.projection, rectifier.rect_from_cam
        rotations = (r, r @ pose[:3, :3].T)
        projections = [
            np.array([[p.f_px, 0, cx, tx], [0, p.f_px, p.cy_px, 0], [0, 0, 1, 0]])
            for cx, tx in ((p.cx_left_px, 0.0), (p.cx_right_px, -p.f_px * p.baseline_m))
        ]
    left, right = (
        CalibrationMessage(
            topic="",
            frame_id="",
            width=camera.width,
            height=camera.height,
            distortion_model=_MODELS[camera.distortion_model],
            D=camera.D if any(camera.D) else (0.0,) * 5,
            K=camera.K,
            R=rotation,
            P=projection,
        )
        for camera, rotation, projection in zip((rig.left, rig.right), rotations, projections, strict=True)
    )
    return left, right


def read_text(path: Path, what: str) -> str:
    """A text file; `what` names it in the error. Raises InputError."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot read {what} {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{what} {path} is no text file") from None


def seconds_to_ns(text: str, where: str) -> int:
    """Decimal seconds as integer nanoseconds, exactly. Raises InputError."""
    try:
        return round(Decimal(text) * 1_000_000_000)
    except (InvalidOperation, ValueError, OverflowError):
        raise InputError(f"{where}: {text!r} is no time in seconds") from None


def ascending(stamps_ns: Sequence[int], where: str | Path) -> None:
    """Raises InputError naming the first line where time does not advance, or is negative."""
    if stamps_ns and stamps_ns[0] < 0:
        raise InputError(f"{where}: the first stamp is negative ({stamps_ns[0]} ns)")
    for line, (a, b) in enumerate(pairwise(stamps_ns), start=2):
        if b <= a:
            raise InputError(
                f"{where}: entry {line} ({b} ns) is not later than the one before it: sort the entries"
            )


def rig_of_files(where: str | Path, left: Camera, right: Camera, right_from_left: Array) -> StereoRig:
    """The rig, errors naming the file it came from. Raises ConfigError."""
    try:
        return StereoRig(left, right, right_from_left)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None
