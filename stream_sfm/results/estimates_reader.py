"""Reads `estimates.mcap` back, whole or as a killed run left it (`estimates.mcap.part`)."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from mcap.well_known import MessageEncoding
from numpy.typing import NDArray

from ..errors import LogError
from ..mcap_file.damage import Damage
from ..mcap_file.log_file import LogFile
from ..recording.ros import ros_decoder
from ..types import Trajectory
from .record_messages import from_message
from .ros_messages import POINT_DTYPE
from .schema import SCHEMA_VERSION, EstimateRecord

_OURS = "/stream_sfm/"  # how most topics of a run's file begin
_FEW_MESSAGES = 100  # of a file, which show what it is


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Cloud:
    """The points of one message: `track_ids` (n,), `points` (n, 3) m, `cov_points` (n, 3, 3) m², float32 as stored."""

    stamp_ns: int
    frame_id: str
    track_ids: NDArray[np.int64]
    points: NDArray[np.float32]
    cov_points: NDArray[np.float32]

    def __repr__(self) -> str:
        return f"<Cloud at {self.stamp_ns} ns in {self.frame_id}, {len(self.points)} points>"


def read_estimates(path: str | Path) -> Iterator[EstimateRecord]:
    """Yield the records in order; a file that is cut off gives those of all whole chunks. Raises LogError."""
    for _, message in _messages(path, "/stream_sfm/estimate"):
        version = getattr(message, "schema_version", None)
        if isinstance(version, int) and version > SCHEMA_VERSION:
            raise LogError(f"{path} was written by a newer stream_sfm (estimate schema {version})")
        try:
            yield from_message(message, EstimateRecord)
        except (TypeError, ValueError, AttributeError) as error:
            raise LogError(f"{path}: a message of /stream_sfm/estimate cannot be read: {error}") from None


def read_trajectory(path: str | Path) -> Trajectory:
    """Read stamps, poses and covariances of all frames, exact to the last bit. Raises LogError."""
    stamps, poses, covs = [], [], []
    for record in read_estimates(path):
        stamps.append(record.stamp_ns)
        poses.append(record.world_from_cam)
        covs.append(record.cov_pose)
    return Trajectory(
        np.array(stamps, dtype=np.int64),
        np.array(poses, dtype=float).reshape(-1, 4, 4),
        np.array(covs, dtype=float).reshape(-1, 6, 6),
    )


def read_clouds(path: str | Path, topic: str = "/stream_sfm/points") -> Iterator[Cloud]:
    """Yield the point clouds of one topic, in order. Raises LogError."""
    for log_time_ns, message in _messages(path, topic):
        try:
            rows = np.frombuffer(message.data, POINT_DTYPE)
            stamp, frame_id = message.header.stamp, message.header.frame_id
        except (ValueError, AttributeError) as error:
            raise LogError(f"{path}: a message of {topic} cannot be read: {error}") from None
        upper = np.stack([rows[name] for name in ("cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz")], -1)
        yield Cloud(
            log_time_ns or stamp.sec * 10**9 + stamp.nanosec,  # the first is never negative, the second has 32 bits
            frame_id,
            rows["track_id"].astype(np.int64),
            np.stack([rows["x"], rows["y"], rows["z"]], axis=-1),
            upper[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]],
        )


def _messages(path: str | Path, topic: str) -> Iterator[tuple[int, Any]]:
    """Yield the log times and the decoded messages of a topic; of a file that is not ours, a LogError."""
    found = False
    for channel, schema, log_time_ns, data, *_ in LogFile(path).messages(Damage(), frozenset([topic])):
        found = True
        if channel.message_encoding != MessageEncoding.CDR or schema is None:
            raise LogError(
                f"{path}: {topic} is encoded as {channel.message_encoding!r}, not as this version writes it "
                "(cdr): replay the log again"
            )
        try:
            decode = ros_decoder(channel.message_encoding, schema.encoding, schema.name, schema.data)
            message = None if decode is None else decode(data)
        except Exception as error:  # rosbags raises exceptions of many kinds
            raise LogError(f"{path}: a message of {topic} cannot be read: {error}") from None
        yield log_time_ns, message
    if not found:
        _check_it_is_ours(path, topic)


def _check_it_is_ours(path: str | Path, topic: str) -> None:
    """Raise LogError where a file without messages of a topic has others: a topic of ours may be empty, as in a short
    run or a killed one."""
    topics = {message.channel.topic for message in islice(LogFile(path).messages(Damage()), _FEW_MESSAGES)}
    ours = any(name.startswith(_OURS) for name in topics) and topic.startswith(_OURS)
    if topics and not ours:
        others = ", ".join(sorted(topics))
        raise LogError(f"{path} has no messages on {topic}, but on {others}: give the estimates.mcap of a run")
