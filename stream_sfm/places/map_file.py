"""A map in a file: keyframes, and the motions between them, so that a later run can continue in its world.

The file is MCAP with messages in MessagePack, described by a JSON schema; arrays are the bytes of little-endian
numbers, row by row. Topics: first `/places/map`, once; then `/places/keyframe` and `/places/motion` (docs/maps.md).
"""

import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .. import __version__
from ..errors import InputError, as_error
from ..geometry.stereo import StereoProjection
from ..logs.mcap_file.log_file import LogFile
from ..logs.mcap_file.log_writer import MessageWriter
from ..logs.mcap_file.message import Channel, Damage, Message
from ..motion import Motion
from ..system.inputs import INT64
from .graph import GraphState, Loop
from .keyframes import Keyframe, are_patches

SCHEMA_VERSION = 1


class MapRecord(msgspec.Struct):
    """The head of the file: its numbers of messages, and the rectified pair to which pixels and patches refer."""

    schema_version: int
    software_version: str
    keyframes: int
    motions: int
    rectified: list[float]  # f, cx left, cx right, cy (px), baseline (m), width, height
    rect_from_cam: list[float]  # 3 × 3


class _AnyVersion(msgspec.Struct):
    """The fields that every version of a MapRecord has."""

    schema_version: Any = None


class KeyframeRecord(msgspec.Struct):
    """One keyframe; segments are parts of the path without a loss; the pose is in the world of segment `home`."""

    number: int
    segment: int
    home: int
    frame_index: int
    stamp_ns: int
    depth_m: float  # median
    world_from_cam: bytes  # 4 × 4 float64
    cov_odometry: bytes  # 6 × 6 float64, since the beginning of the segment: m, rad
    odom_from_cam: bytes  # 4 × 4 float64
    points: bytes  # n × 3 float32, m, rectified axes
    cov_points: bytes  # n × 3 × 3 float32
    patches: bytes  # JPEG: a mosaic
    feature_px: bytes  # m × 2 float32
    feature_points: bytes  # m × 3 float32
    descriptors: bytes  # m × 32 uint8: ORB


class MotionRecord(msgspec.Struct):
    """The motion between two keyframes, by odometry or as a loop."""

    first: int
    second: int
    loop: bool
    first_from_second: bytes  # 4 × 4 float64
    cov: bytes  # 6 × 6 float64, of the perturbation on the right, translation first


Record = MapRecord | KeyframeRecord | MotionRecord
_TOPICS: dict[str, type[Record]] = {
    "/places/map": MapRecord,
    "/places/keyframe": KeyframeRecord,
    "/places/motion": MotionRecord,
}
_CHANNELS = {
    kind: Channel(topic, "msgpack", kind.__name__, "jsonschema", json.dumps(msgspec.json.schema(kind)).encode())
    for topic, kind in _TOPICS.items()
}


def save_map(
    path: str | Path,
    projection: StereoProjection,
    rect_from_cam: NDArray[np.float64],
    keyframes: list[Keyframe],
    state: GraphState,
) -> None:
    """Write a map; the file appears when it is complete. Raises OutputError."""
    motions = [*((*pair, False, link) for pair, link in state.links.items())]
    motions += [(loop.old, loop.new, True, loop.motion) for loop in state.loops]
    with MessageWriter(path, compressed=True) as file:

        def write(record: Record, stamp_ns: int = 0) -> None:
            file.write(Message(_CHANNELS[type(record)], stamp_ns, msgspec.msgpack.encode(record)))

        rig = _numbers(projection), rect_from_cam.ravel().tolist()
        write(MapRecord(SCHEMA_VERSION, __version__, len(keyframes), len(motions), *rig))
        for k, frame in enumerate(keyframes):
            kept: dict[str, Any] = {f.name: getattr(frame, f.name) for f in fields(frame)}
            kept |= {"world_from_cam": state.poses[k], "cov_odometry": state.covs[k]}
            kept |= {"number": state.numbers[k], "segment": state.segments[k], "home": state.homes[k]}
            arrays = {name: x.tobytes() for name, x in kept.items() if isinstance(x, np.ndarray)}
            write(KeyframeRecord(**kept | arrays), frame.stamp_ns)
        for first, second, is_loop, link in motions:
            write(MotionRecord(first, second, is_loop, link.earlier_from_newest.tobytes(), link.cov.tobytes()))


def load_map(
    path: str | Path, projection: StereoProjection, rect_from_cam: NDArray[np.float64]
) -> tuple[list[Keyframe], GraphState]:
    """Read a map of this rig. Raises InputError for any other or damaged file."""
    with as_error(InputError, f"{path} cannot be used as a map", ValueError, msgspec.MsgspecError):
        return _loaded(list(_records(Path(path))), projection, rect_from_cam)


def _records(path: Path) -> Iterator[Record]:
    damage = Damage()
    for stored in LogFile(path).messages(damage, frozenset(_TOPICS)):
        kind = _TOPICS[stored.channel.topic]
        if stored.channel.message_encoding != "msgpack":
            raise ValueError(f"{stored.channel.topic} is not of a map that PlaceMap.save has written")
        if kind is MapRecord:
            version = msgspec.msgpack.decode(stored.data, type=_AnyVersion).schema_version
            if version != SCHEMA_VERSION:
                raise ValueError(f"it is of version {version!r}, and this stream_sfm reads {SCHEMA_VERSION}")
        yield msgspec.msgpack.decode(stored.data, type=kind)
    if not damage.complete:
        raise ValueError("it is damaged: " + "; ".join(damage.notes))


def _loaded(
    records: list[Record], projection: StereoProjection, rect_from_cam: NDArray[np.float64]
) -> tuple[list[Keyframe], GraphState]:
    heads = [record for record in records if isinstance(record, MapRecord)]
    frames = [record for record in records if isinstance(record, KeyframeRecord)]
    motions = [record for record in records if isinstance(record, MotionRecord)]
    if len(heads) != 1:
        raise ValueError("it is not a file that PlaceMap.save has written")
    rig = [*heads[0].rectified, *heads[0].rect_from_cam]
    ours = [*_numbers(projection), *rect_from_cam.ravel()]
    if len(rig) != len(ours) or not np.allclose(rig, ours, rtol=0, atol=1e-9):  # px, m and rad: except for rounding
        raise ValueError("it was made with another calibration; use the one it was made with")
    if (len(frames), len(motions)) != (heads[0].keyframes, heads[0].motions) or not frames:
        raise ValueError("it is not complete")
    numbers = [record.number for record in frames]
    if numbers != sorted(set(numbers)) or not 0 <= numbers[0] <= numbers[-1] < INT64 // 2:  # others follow
        raise ValueError("its keyframes are not numbered in order")
    segments, homes = [r.segment for r in frames], [r.home for r in frames]
    if min(segments + homes) < 0 or max(segments + homes) >= INT64 // 2 or not set(homes) <= set(segments):
        raise ValueError("it has a keyframe without a segment")
    known = set(numbers)
    links: dict[tuple[int, int], Motion] = {}
    loops: list[Loop] = []
    for record in motions:
        if record.first == record.second or not {record.first, record.second} <= known:
            raise ValueError(f"it has a motion from {record.first} to {record.second}, which are not two keyframes")
        link = Motion(_pose(record.first_from_second), _cov(record.cov))
        if record.loop:
            loops.append(Loop(record.first, record.second, link))
        else:
            links[record.first, record.second] = link
    _check_connected(numbers, homes, [*links, *((loop.old, loop.new) for loop in loops)])
    poses = np.array([_pose(record.world_from_cam) for record in frames])
    covs = np.array([_cov(record.cov_odometry) for record in frames])
    return [_keyframe(r) for r in frames], GraphState(numbers, segments, homes, poses, covs, links, loops)


def _check_connected(numbers: list[int], homes: list[int], pairs: list[tuple[int, int]]) -> None:
    """Raise a ValueError if no motion connects keyframes of one world, so that there is no solution."""
    rows = np.searchsorted(numbers, np.array(pairs, np.int64).reshape(-1, 2))
    near = coo_array((np.ones(len(rows)), (rows[:, 0], rows[:, 1])), shape=2 * (len(numbers),))
    _, parts = connected_components(near, directed=False)
    worlds = dict(zip(homes, parts.tolist(), strict=True))
    apart = [number for number, home, part in zip(numbers, homes, parts, strict=True) if worlds[home] != part]
    if apart:
        raise ValueError(f"no motion connects its keyframe {apart[0]} with others of the same world")


def _keyframe(record: KeyframeRecord) -> Keyframe:
    found = Keyframe(
        record.frame_index,
        record.stamp_ns,
        _pose(record.odom_from_cam),
        _array(record.points, np.float32, 3),
        _array(record.cov_points, np.float32, 3, 3),
        record.patches,
        _array(record.feature_px, np.float32, 2),
        _array(record.feature_points, np.float32, 3),
        _array(record.descriptors, np.uint8, 32),
        record.depth_m,
    )
    features = {len(found.feature_px), len(found.feature_points), len(found.descriptors)}
    sound = len(found.points) == len(found.cov_points) and len(features) == 1 and 0 < record.depth_m < np.inf
    if not sound or abs(record.stamp_ns) >= INT64 or not are_patches(record.patches, len(found.points)):
        raise ValueError(f"the content of keyframe {record.number} does not fit together")
    return found


def _numbers(p: StereoProjection) -> list[float]:
    return [float(x) for x in (p.f_px, p.cx_left_px, p.cx_right_px, p.cy_px, p.baseline_m, p.width, p.height)]


def _array(data: bytes, kind: DTypeLike, *row: int) -> NDArray[Any]:
    array = np.frombuffer(data, kind).reshape(-1, *row)
    if not np.isfinite(array).all():
        raise ValueError("it holds numbers that are not finite")
    return array


def _pose(data: bytes) -> NDArray[np.float64]:
    (pose,) = _array(data, np.float64, 4, 4)
    if not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-6) or (pose[3] != (0, 0, 0, 1)).any():
        raise ValueError("it holds a pose that is not a rigid motion")
    return pose.astype(float)


def _cov(data: bytes) -> NDArray[np.float64]:
    (cov,) = _array(data, np.float64, 6, 6)
    if not np.allclose(cov, cov.T, rtol=1e-6) or np.linalg.eigvalsh(cov)[0] < -1e-9 * np.trace(cov):
        raise ValueError("it holds a covariance that is not positive definite")
    return cov.astype(float)
