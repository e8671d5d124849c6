"""Image files with stamps, a rig and ground truth as a source: messages of the log profile, made on the way."""

import heapq
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...camera.models import MAX_PIXELS, Camera
from ...camera.rectification import check_rectifiable
from ...camera.rig import StereoRig
from ...errors import ConfigError, LogError, RigError, as_error
from ...geometry import Array
from ...inertial.samples import ImuCalibration
from ...record import record
from ...system.inputs import LIMITS, read_small, reading
from ..mcap_file.message import Channel, Contents, Damage, Message, Source
from .image_header import FORMATS, image_format, image_size, plain_size
from .profile import ProfileEncoder


@record
class ImageFile:
    """An image on disk and its stamp; an image in an archive has its `content` from there."""

    stamp_ns: int
    path: Path

    def content(self) -> bytes:
        """Return the bytes of the file. Raises LogError."""
        with reading(f"image {self.path}"):
            return read_small(self.path, LIMITS.image_file_bytes)

    @property
    def size_bytes(self) -> int:
        """Return the size of the file in bytes; 0 for a missing one, which reading will report."""
        return os.path.getsize(self.path) if os.path.isfile(self.path) else 0

    def read(self, camera: Camera | None = None) -> tuple[bytes, str]:
        """Return bytes and format, of the camera's size if given. Raises LogError naming file and remedy."""
        path, data = self.path, self.content()
        encoding = image_format(data)
        if encoding is None and (plain := plain_size(data)) is not None:
            data, encoding = _as_png(path, data, plain), "png"
        if encoding is None:
            *names, last = (of.name for of in FORMATS)
            raise LogError(f"{path} is not a {', '.join(names)} or {last} image: convert the images to PNG first")
        size = image_size(data)
        if size is None:
            raise LogError(f"{path}: the header of this image is damaged: fetch it again, or leave it out")
        if camera is not None and size != (camera.width, camera.height):
            problem = f"{path} is {size[0]}×{size[1]}, the calibration is for {camera.width}×{camera.height}"
            raise LogError(f"{problem}: give images of the calibrated size, or the calibration of these images")
        return data, encoding

    def size(self) -> tuple[int, int]:
        """Return width and height, pixels. Raises LogError."""
        size = image_size(self.read()[0])
        assert size is not None  # `read` has checked it
        return size


class ImageFilesSource(Source):
    """Left and right images (no right ones with one camera) and poses (stamp_ns, world_from_cam), in order of time.

    `format` names the data set; `std_truth`: σ of the poses, m and rad; `imu`: samples (stamp_ns, (6,) rad/s and m/s²)
    of an inertial unit. An image that cannot be read, or has another size than the rig's, is skipped and added to the
    damage of a reading. Raises LogError where left and right images are of different times, ConfigError where no image
    can be rectified by the rig.
    """

    def __init__(
        self,
        path: Path,
        format: str,
        rig: StereoRig | None,
        images: tuple[Sequence[ImageFile], Sequence[ImageFile]],
        poses: Sequence[tuple[int, Array]] = (),
        notes: Sequence[str] = (),
        imu: tuple[Sequence[tuple[int, Array]], ImuCalibration] | None = None,
        std_truth: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.path, self.format, self.rig = path, format, rig
        self._samples: Sequence[tuple[int, Array]] = () if imu is None else imu[0]
        self.imu = None if imu is None else imu[1]
        if rig is not None:
            with as_error(ConfigError, f"{path}", RigError):
                check_rectifiable(rig)
        self.images, self.poses, self._std_truth = images, poses, std_truth
        self.notes = list(notes)
        left, right = ({image.stamp_ns for image in side} for side in images)
        if left and right and (min(left) > max(right) or min(right) > max(left)):
            raise LogError(f"{path}: the left and the right images are of different times: are they of one recording?")
        self.without_partner = len(left ^ right) if right else 0  # images
        self.size_bytes = sum(image.size_bytes for side in images for image in side)

    def contents(self) -> Contents | None:
        """Return the contents, known from the lists of files."""
        encoder = ProfileEncoder(self.rig, self._std_truth)
        stamps = [image.stamp_ns for side in self.images for image in side]
        channels: list[tuple[Channel, int | None]] = [*zip(encoder.images, map(len, self.images), strict=True)]
        if self.rig is not None:
            channels += [(channel, None) for channel in encoder.calibrations]
        if self.poses:
            channels.append((encoder.poses, len(self.poses)))
        if self._samples:
            channels += [(encoder.imu, len(self._samples)), (encoder.transforms, 1)]
        return Contents(channels, min(stamps), max(stamps))

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all) in order of time: at one stamp the pose, then left, then right."""
        damage.notes += self.notes
        encoder = ProfileEncoder(self.rig, self._std_truth)
        cameras = (None, None) if self.rig is None else (self.rig.left, self.rig.right)
        events: Iterator[tuple[int, int, ImageFile | Array]] = heapq.merge(
            ((stamp, 0, pose) for stamp, pose in self.poses),
            ((image.stamp_ns, 1, image) for image in self.images[0]),
            ((image.stamp_ns, 2, image) for image in self.images[1]),
            ((stamp, 3, values) for stamp, values in self._samples),
            key=lambda event: event[:2],
        )

        def wanted(messages: Iterable[Message]) -> Iterator[Message]:
            return (m for m in messages if topics is None or m.channel.topic in topics)

        unmounted = self.imu
        for stamp_ns, kind, item in events:
            if unmounted is not None:
                yield from wanted([encoder.imu_mounting(stamp_ns, unmounted)])
                unmounted = None
            if not isinstance(item, ImageFile):
                yield from wanted([(encoder.imu_sample if kind == 3 else encoder.pose)(stamp_ns, item)])
                continue
            side = kind - 1
            yield from wanted(encoder.due_calibration(side, stamp_ns))
            if topics is None or encoder.images[side].topic in topics:
                try:
                    data, encoding = item.read(cameras[side])
                except LogError as error:
                    damage.add(str(error))
                    continue
                damage.bytes_read += len(data)
                yield encoder.image(side, stamp_ns, data, encoding)


def _as_png(path: Path, data: bytes, size: tuple[int, int]) -> bytes:
    """Convert an image whose format logs do not support to PNG, without loss."""
    import cv2

    image = None
    if 0 < size[0] * size[1] <= MAX_PIXELS:  # checked before a few bytes become gigabytes
        with suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    if image is None or image.dtype not in (np.uint8, np.uint16):
        problem = f"{path}: this image of {size[0]}×{size[1]} pixels cannot be decoded"
        raise LogError(f"{problem}: convert the images to PNG")
    return cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
