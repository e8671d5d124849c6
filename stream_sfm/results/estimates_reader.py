"""Reads `estimates.mcap` back, whole, damaged, or as a killed run left it (`estimates.mcap.part`)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from mcap.well_known import MessageEncoding
from numpy.typing import NDArray

from ..camera.rig import MonoRig, StereoRig
from ..errors import LogError
from ..logs.mcap_file.log_file import LogFile
from ..logs.mcap_file.message import Damage, Message
from ..logs.recording.ros import ros_decoder
from ..types import FrameEstimate
from .own_messages import SCHEMA_VERSION, estimate_of
from .ros_messages import COVARIANCE_FIELDS, POINT_DTYPE

_OURS = "/stream_sfm/"  # prefix of most topics in the file of a run
_MATRIX_FROM_UPPER = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Cloud:
    """The points of one message: `track_ids` (n,), `points` (n, 3) m, `cov_points` (n, 3, 3) m², float32 as stored."""

    stamp_ns: int
    frame_id: str
    track_ids: NDArray[np.int64]
    points: NDArray[np.float32]
    cov_points: NDArray[np.float32]
    frame_index: int = -1  # the frame with which it was written

    def __repr__(self) -> str:
        return f"<Cloud at {self.stamp_ns} ns in {self.frame_id}, {len(self.points)} points>"


def read_estimates(
    path: str | Path, warnings: list[str] | None = None, points: bool = False
) -> Iterator[FrameEstimate]:
    """Yield the readable frames in order, as the sinks of the run received them, as far as they are recorded.

    Points in the world, points that have left the view and times per stage are omitted; so are points in view without
    `points` (`read_clouds` has them). Damage is added to `warnings`. Without such a list, it raises LogError after the
    last frame, except for a `.part` file of a killed run, whose end is always missing.
    """
    clouds = read_clouds(path, warnings=[]) if points else iter(())
    cloud = next(clouds, None)

    def estimate(stored: Message, message: Any) -> FrameEstimate:
        nonlocal cloud
        if message.schema_version > SCHEMA_VERSION:
            raise LogError(f"it was written by a newer stream_sfm (estimate schema {message.schema_version})")
        while cloud is not None and cloud.frame_index < message.frame_index:
            cloud = next(clouds, None)
        if cloud is None or cloud.frame_index != message.frame_index:
            return estimate_of(message)
        return estimate_of(message, (cloud.track_ids, cloud.points, cloud.cov_points))

    yield from _read(Path(path), "/stream_sfm/estimate", estimate, warnings)


def read_clouds(
    path: str | Path, topic: str = "/stream_sfm/points", warnings: list[str] | None = None
) -> Iterator[Cloud]:
    """Yield the point clouds of one topic, in order; damage as in `read_estimates`."""
    yield from _read(Path(path), topic, _cloud, warnings)


def recorded_rig(path: str | Path) -> StereoRig | MonoRig:
    """Return the rig of an `estimates.mcap`, from the calibration attached to it. Raises LogError if there is none."""
    for attachment in LogFile(path).attachments(Damage()):
        if attachment.name == "calibration.toml":
            kind = StereoRig if b"[right" in attachment.data else MonoRig
            return kind.parse_calibration(attachment.data, f"{path}, {attachment.name}")
    raise LogError(f"{path} holds no calibration: replay the log again")


def _cloud(stored: Message, message: Any) -> Cloud:
    rows, stamp = np.frombuffer(message.data, POINT_DTYPE), message.header.stamp
    upper = np.stack([rows[name] for name in COVARIANCE_FIELDS], axis=-1)
    return Cloud(
        # The log time is never negative; the stamp of a header has 32 bits.
        stored.log_time_ns or stamp.sec * 10**9 + stamp.nanosec,
        message.header.frame_id,
        rows["track_id"].astype(np.int64),
        np.stack([rows["x"], rows["y"], rows["z"]], axis=-1),
        upper[:, _MATRIX_FROM_UPPER],
        stored.sequence,
    )


def _read(
    path: Path, topic: str, convert: Callable[[Message, Any], Result], warnings: list[str] | None
) -> Iterator[Result]:
    """Yield each message of a topic through `convert`. Raises LogError, also if the file is not one of ours."""
    damage, found = Damage(), False
    for stored in LogFile(path).messages(damage, frozenset([topic])):
        found = True
        try:
            result = convert(stored, _decoded(stored, topic))
        except LogError as error:  # of the whole file
            raise LogError(f"{path}: {error}") from None
        except Exception as error:  # rosbags raises exceptions of many kinds
            damage.add(f"{path}: a message of {topic} cannot be read: {error}")
            continue
        yield result
    if not found:
        _check_it_is_ours(path, topic)
    if warnings is not None:
        warnings += [note for note in damage.notes if note not in warnings]
    elif not damage.complete and path.suffix != ".part":
        raise LogError("; ".join(damage.notes))


def _decoded(stored: Message, topic: str) -> Any:
    channel = stored.channel
    if (encoding := channel.message_encoding) != MessageEncoding.CDR:
        raise LogError(f"{topic} is encoded as {encoding!r}, and this version reads cdr: replay the log again")
    decode = ros_decoder(encoding, channel.schema_encoding, channel.schema_name, channel.definition)
    if decode is None:
        raise ValueError("its type is not described")
    return decode(stored.data)


def _check_it_is_ours(path: Path, topic: str) -> None:
    """Raise LogError if a file has messages, but none of a run. In a short run, a topic may be empty."""
    few = 100  # messages, enough to recognise it
    topics = {message.channel.topic for message in islice(LogFile(path).messages(Damage()), few)}
    ours = any(name.startswith(_OURS) for name in topics) and topic.startswith(_OURS)
    if topics and not ours:
        others = ", ".join(sorted(topics))
        raise LogError(f"{path} has no messages on {topic}, but on {others}: give the estimates.mcap of a run")
