"""Ground truth in a log: the poses of the physical left camera, and depth images.

A topic is ground truth when its name says so. A message that names its child frame must name the left camera's:
the pose of another body would be off by an unknown mounting, and is refused with a warning.
"""

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError
from ..types import Trajectory
from .images import UndecodableImage, decode_grey
from .messages import MessageDecoder, PoseMessage, UndecodableMessage
from .records import Damage, LogFile
from .survey import Survey

DEPTH_TOPIC = "/ground_truth/depth"
_DEPTH_UNIT_M = 1e-4
_TRUTH = re.compile(r"ground_?truth|(?<![a-z])gt(?![a-z])|mocap|vicon", re.IGNORECASE)
_LEFT_CAMERA = re.compile(r"(?<![a-z])(left|cam_?0|camera_?0|camera|cam)(?![a-z])", re.IGNORECASE)


def truth_topic(survey: Survey) -> str | None:
    """The topic of ground-truth poses, None where there is none."""
    topics = [t for t, count in survey.of_kind("pose").items() if _TRUTH.search(t) and count != 0]
    return min(topics, key=lambda t: ("pose" not in t.lower(), len(t), t), default=None)


def read_truth(file: LogFile, topic: str, camera_frame: str, warnings: list[str]) -> Trajectory | None:
    """The poses on `topic` as `world_from_cam`, ascending in time; None, with a warning, where none can be used."""
    decoder = MessageDecoder(file.path)
    poses: dict[int, PoseMessage] = {}
    refused: set[str] = set()
    for message in file.messages(Damage(), frozenset([topic])):
        try:
            read = decoder.poses(message)
        except UndecodableMessage as error:
            warnings.append(f"ground truth: {error}") if not refused else None
            refused.add("")
            continue
        except LogError as error:
            warnings.append(f"ground truth is not used: {error}")
            return None
        for pose in read:
            if pose.child and pose.child != camera_frame and not _LEFT_CAMERA.search(pose.child):
                refused.add(pose.child)
            else:
                poses.setdefault(pose.stamp_ns, pose)
    if not poses:
        of = f": it is of {', '.join(sorted(refused - {''}))}, not of {camera_frame}" if refused - {""} else ""
        warnings.append(f"ground truth on {topic} is not used{of}")
        return None
    stamps = sorted(poses)
    return Trajectory(np.array(stamps, dtype=np.int64), np.stack([poses[s].parent_from_child for s in stamps]))


def read_depths(file: LogFile, warnings: list[str]) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """(stamp_ns, depth (h, w) float32, metres, NaN where unknown) of each image on `DEPTH_TOPIC`."""
    decoder = MessageDecoder(file.path)
    for message in file.messages(Damage(), frozenset([DEPTH_TOPIC])):
        try:
            image = decoder.image(message)
            raw = decode_grey(image)
        except (UndecodableMessage, UndecodableImage) as error:
            warnings.append(f"a depth image is passed over: {error}")
            continue
        if raw.dtype != np.uint16:
            raise LogError(f"{file.path}: topic {DEPTH_TOPIC}: depth must be 16-bit in units of 0.1 mm")
        yield image.stamp_ns, np.where(raw > 0, raw * np.float32(_DEPTH_UNIT_M), np.float32(np.nan))
