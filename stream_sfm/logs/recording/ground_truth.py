"""Ground truth in a log: the poses of the physical left camera, and depth images.

A topic is ground truth if its name says so. If a message names its child frame, that must be the left camera: the
pose of another body would be wrong by an unknown mounting, and is refused with a warning.
"""

import re
from array import array
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, LogError
from ...evaluation.association import first_of_each
from ...evaluation.settings import SETTINGS
from ...system.wording import LISTED
from ...types import Trajectory
from ..mcap_file.message import Message, Source
from ..sources.profile import STD_KEYS
from .images import decode_depth_m
from .messages import MessageDecoder, decoded
from .survey import Survey

Depth = NDArray[np.float32]  # (h, w) metres along the optical axis, NaN where unknown

_DEPTH_TOPICS = ("/ground_truth/depth", "/ground_truth/depth/compressedDepth")  # the second by image_transport
_TRUTH = re.compile(r"ground_?truth|(?<![a-z])gt(?![a-z])|mocap|vicon", re.IGNORECASE)
_LEFT_CAMERA = re.compile(r"(?<![a-z])(left|cam_?0|camera_?0|camera|cam)(?![a-z])", re.IGNORECASE)


def truth_topic(survey: Survey) -> str | None:
    """Return the topic of ground-truth poses, or None."""
    topics = [t for t, count in survey.of_kind("pose", "transform").items() if _TRUTH.search(t) and count != 0]
    return min(topics, key=lambda t: ("pose" not in t.lower(), len(t), t), default=None)


def std_of_truth(survey: Survey) -> tuple[float, float]:
    """Return σ of the poses of ground truth, m and rad, that the metadata of their channel gives; else zeros."""
    topic = truth_topic(survey)
    given = {} if topic is None else survey.topics[topic].metadata
    with suppress(KeyError, ValueError):
        std = float(given[STD_KEYS[0]]), float(given[STD_KEYS[1]])
        if min(std) >= 0 and np.isfinite(std).all():
            return std
    return 0.0, 0.0


def read_truth(
    source: Source, topic: str, camera_frame: str, warnings: list[str], until_ns: int | None = None
) -> Trajectory | None:
    """Return the poses on `topic` as `world_from_cam`, ascending; None, with a warning, if none can be used.

    Reading ends a second after `until_ns`: messages may be that late.
    """
    stamps_ns, poses = array("q"), array("d")  # arrays, as a tracker at 1 kHz gives millions per hour
    other_frames: set[str] = set()

    def tell(problem: str) -> None:
        warnings.append(f"ground-truth messages that cannot be read were skipped, the first: {problem}")

    try:
        for pose in chain.from_iterable(decoded(source, [topic], MessageDecoder.poses, tell)):
            if until_ns is not None and pose.stamp_ns > until_ns + 10**9:
                break
            if not pose.child or pose.child == camera_frame or _LEFT_CAMERA.search(pose.child):
                stamps_ns.append(pose.stamp_ns)
                poses.frombytes(pose.parent_from_child.tobytes())
            elif len(other_frames) < LISTED:
                other_frames.add(pose.child)
    except LogError as error:
        warnings.append(f"ground truth is not used: {error}")
        return None
    if not stamps_ns:
        of = f": it is of {', '.join(sorted(other_frames))}, not of {camera_frame}" if other_frames else ""
        warnings.append(f"ground truth on {topic} is not used{of}")
        return None
    stamps = np.frombuffer(stamps_ns, np.int64)
    first = first_of_each(stamps)
    return Trajectory(stamps[first], np.frombuffer(poses).reshape(-1, 4, 4)[first])


def depth_topic(survey: Survey) -> str | None:
    images = survey.of_kind("image")
    return next((t for t in _DEPTH_TOPICS if images.get(t, 0) != 0), None)


def read_depths(source: Source, topic: str, warnings: list[str]) -> Iterator[tuple[int, Depth]]:
    """Yield (stamp_ns, depth) of each image on `topic`; images that cannot be read are skipped with a warning."""

    def decode(decoder: MessageDecoder, message: Message) -> tuple[int, Depth]:
        image = decoder.image(message)
        return image.stamp_ns, decode_depth_m(image)

    def tell(problem: str) -> None:
        warnings.append(f"depth images that cannot be read were skipped, the first: {problem}")

    yield from decoded(source, [topic], decode, tell)


class DepthImages:
    """Looks up depth images by ascending stamps, and holds only one image at a time.

    After one that cannot be read there are no more, and `problem` says why. Several threads may call it.
    """

    def __init__(self, images: Iterator[tuple[int, Depth]]) -> None:
        """Start with `images` as `StereoLog.depths` yields them."""
        self._images = images
        self._current: tuple[int, Depth] | None = None
        self._exhausted = False
        self._lock = Lock()
        self.problem = ""

    def at(self, stamp_ns: int) -> Depth | None:
        """Return the depth image of this moment (within 1 ms, as stamps may be rounded), or None."""
        with self._lock:
            first_ns = stamp_ns - SETTINGS.same_stamp_ns
            while not self._exhausted and (self._current is None or self._current[0] < first_ns):
                try:
                    self._current = next(self._images, None)
                except InputError as error:
                    self._current, self.problem = None, f"ground-truth depth is not compared: {error}"
                self._exhausted = self._current is None
            if self._current is None or abs(self._current[0] - stamp_ns) > SETTINGS.same_stamp_ns:
                return None
            return self._current[1]
