"""Writes `estimates.mcap`: everything a run estimates, for Foxglove, Rerun, ROS and evo.

| topic | schema | content |
|---|---|---|
| /stream_sfm/pose | foxglove.PoseInFrame | the left camera in `world` |
| /stream_sfm/odometry | ROS 2 nav_msgs/msg/Odometry | the same with its covariance in ROS's convention |
| /tf | foxglove.FrameTransform | `world` to `left_camera` |
| /stream_sfm/points | foxglove.PointCloud | CC local structure in `left_camera`, one message per frame |
| /stream_sfm/map | foxglove.PointCloud | WC structure in `world`: points that left the estimator, each once |
| /stream_sfm/estimate | JSON, `EstimateRecord` | status, pose, covariance, window, counts |
| /stream_sfm/timing | JSON, `TimingRecord` | milliseconds per stage |

The profile is `ros2`, without which rosbags and evo refuse a file; `summary_order` says what else they need.
Metadata `stream_sfm` (software_version, schema_version, method) and `configuration` (config.toml); attachment
`calibration.toml`. All times of a message are the frame's stamp, its sequence the frame index; two runs differ
in /stream_sfm/timing only. A chunk is closed at the latest after half a second of log time or 20 frames, and the
file is moved to its name by `close`: a process that is killed leaves all but the last chunk in `<name>.part`,
which `read_estimates` reads.
"""

from io import BytesIO
from pathlib import Path
from typing import IO, Any, cast

import mcap
import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema
from msgspec import json

from .. import __version__
from ..camera.rig import MonoRig, StereoRig
from ..config import Config, config_to_toml
from ..errors import OutputError
from ..files import PartFile
from ..geometry import se3
from ..geometry.se3 import Array
from ..mcap_file.summary_order import reorder_summary
from ..types import Frame, FrameEstimate
from . import ros as odometry
from .schema import SCHEMA_VERSION, EstimateRecord, TimingRecord, estimate_record, json_schema

WORLD_FRAME = "world"
CAMERA_FRAME = "left_camera"
_CHUNK_NS = 500_000_000  # a chunk is closed after this much log time: what a killed process loses at most
_CHUNK_FRAMES = 20  # and after this many frames, at the latest
_CHUNK_BYTES = 4 * 2**20  # and at this size; never reached by 20 frames of 200 points
_UPPER = np.triu_indices(3)

# the layout of one point in both clouds: sigma_m is the square root of the covariance's trace
POINT_DTYPE = np.dtype(
    [
        (name, "<f4")
        for name in ("x", "y", "z", "sigma_m", "cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz")
    ]
    + [("track_id", "<u4")]
)


class EstimatesWriter:
    """A sink that writes estimates. Raises OutputError where the file cannot be written."""

    def __init__(self, path: str | Path, rig: StereoRig | MonoRig, config: Config) -> None:
        self._file = PartFile(path)
        self._stream = _Stream(self._file)
        self._writer = Writer(cast(IO[Any], self._stream), chunk_size=_CHUNK_BYTES, use_summary_offsets=False)
        self._writer.start("ros2", library=f"stream_sfm {__version__}, mcap {mcap.__version__}")
        self._writer.add_metadata(
            "stream_sfm",
            {
                "software_version": __version__,
                "schema_version": str(SCHEMA_VERSION),
                "method": config.method,
                "unscaled": str(rig.unscaled).lower(),
            },
        )
        self._writer.add_metadata("configuration", {"config.toml": config_to_toml(config)})
        self._writer.add_attachment(0, 0, "calibration.toml", "application/toml", rig.to_toml().encode())
        self._channels = self._register()
        self._writer.flush()
        self._chunk_began_ns = 0
        self._frames_in_chunk = 0
        self._last: FrameEstimate | None = None
        self._closed = False

    def _register(self) -> dict[str, int]:
        writer = self._writer
        clouds = register_schema(writer, PointCloud)
        odometry_schema = writer.register_schema(
            odometry.SCHEMA_NAME, SchemaEncoding.ROS2, odometry.SCHEMA_TEXT.encode()
        )
        records = {
            kind: writer.register_schema(name, SchemaEncoding.JSONSchema, json_schema(kind))
            for kind, name in ((EstimateRecord, "stream_sfm.Estimate"), (TimingRecord, "stream_sfm.Timing"))
        }
        kinds = {
            "/stream_sfm/pose": (MessageEncoding.Protobuf, register_schema(writer, PoseInFrame)),
            "/stream_sfm/odometry": (MessageEncoding.CDR, odometry_schema),
            "/tf": (MessageEncoding.Protobuf, register_schema(writer, FrameTransform)),
            "/stream_sfm/points": (MessageEncoding.Protobuf, clouds),
            "/stream_sfm/map": (MessageEncoding.Protobuf, clouds),
            "/stream_sfm/estimate": (MessageEncoding.JSON, records[EstimateRecord]),
            "/stream_sfm/timing": (MessageEncoding.JSON, records[TimingRecord]),
        }
        return {topic: writer.register_channel(topic, kind, schema) for topic, (kind, schema) in kinds.items()}

    def write(self, estimate: FrameEstimate, frame: Frame | None = None) -> None:
        """Append all messages of one frame."""
        stamp = estimate.stamp_ns
        if self._frames_in_chunk == 0:
            self._chunk_began_ns = stamp
        pose = estimate.world_from_cam
        self._add(estimate, "/stream_sfm/pose", _pose_in_frame(stamp, pose))
        odometry_message = odometry.encode_odometry(stamp, WORLD_FRAME, CAMERA_FRAME, pose, estimate.cov_pose)
        self._add(estimate, "/stream_sfm/odometry", odometry_message)
        self._add(estimate, "/tf", _frame_transform(stamp, pose))
        cloud = _cloud(stamp, CAMERA_FRAME, estimate.track_ids, estimate.points_in_cam, estimate.cov_points)
        self._add(estimate, "/stream_sfm/points", cloud)
        if len(estimate.ended_ids):
            ended = estimate.ended_points_in_world, estimate.ended_cov_points_in_world
            self._add(estimate, "/stream_sfm/map", _cloud(stamp, WORLD_FRAME, estimate.ended_ids, *ended))
        self._add(estimate, "/stream_sfm/estimate", json.encode(estimate_record(estimate)))
        timing = TimingRecord(
            frame_index=estimate.frame_index, stamp_ns=stamp, timings_ms=dict(estimate.timings_ms)
        )
        self._add(estimate, "/stream_sfm/timing", json.encode(timing))
        self._last = estimate
        self._frames_in_chunk += 1
        if self._frames_in_chunk >= _CHUNK_FRAMES or abs(stamp - self._chunk_began_ns) >= _CHUNK_NS:
            self._writer.flush()
            self._frames_in_chunk = 0

    def close(self) -> None:
        """Add the points still visible to the map, finish the file and move it into place."""
        if self._closed:
            return
        self._closed = True
        try:
            self._finish()
        except OutputError:
            self._file.close()  # raises the same error
            raise
        self._file.close()

    def _finish(self) -> None:
        last = self._last
        if last is not None and len(last.track_ids):
            live = last.points_in_world, last.cov_points_in_world
            self._add(last, "/stream_sfm/map", _cloud(last.stamp_ns, WORLD_FRAME, last.track_ids, *live))
        self._writer.flush()
        offset = self._stream.tell()
        tail = self._stream.hold()
        self._writer.finish()
        self._file.write(reorder_summary(tail.getvalue(), offset))

    def _add(self, estimate: FrameEstimate, topic: str, data: bytes) -> None:
        stamp = max(estimate.stamp_ns, 0)  # MCAP's times are unsigned
        self._writer.add_message(self._channels[topic], stamp, data, stamp, estimate.frame_index)


class _Stream:
    """Passes on what the MCAP writer writes, until it is told to hold it back."""

    def __init__(self, file: PartFile) -> None:
        self._file = file
        self._held: BytesIO | None = None

    def hold(self) -> BytesIO:
        self._held = BytesIO()
        return self._held

    def write(self, data: bytes) -> int:
        return self._file.write(data) if self._held is None else self._held.write(data)

    def tell(self) -> int:
        return self._file.tell() + (0 if self._held is None else self._held.tell())

    def flush(self) -> None:
        self._file.flush()


def _pose_in_frame(stamp_ns: int, world_from_cam: Array) -> bytes:
    message = PoseInFrame(frame_id=WORLD_FRAME)
    _set_time(message.timestamp, stamp_ns)
    _set_pose(message.pose.position, message.pose.orientation, world_from_cam)
    data: bytes = message.SerializeToString(deterministic=True)
    return data


def _frame_transform(stamp_ns: int, world_from_cam: Array) -> bytes:
    message = FrameTransform(parent_frame_id=WORLD_FRAME, child_frame_id=CAMERA_FRAME)
    _set_time(message.timestamp, stamp_ns)
    _set_pose(message.translation, message.rotation, world_from_cam)
    data: bytes = message.SerializeToString(deterministic=True)
    return data


def _cloud(stamp_ns: int, frame_id: str, track_ids: Any, points: Array, cov: Array) -> bytes:
    rows = np.zeros(len(points), POINT_DTYPE)
    rows["x"], rows["y"], rows["z"] = np.asarray(points).reshape(-1, 3).T
    upper = np.asarray(cov).reshape(-1, 3, 3)[:, _UPPER[0], _UPPER[1]]
    with np.errstate(over="ignore"):
        for name, column in zip(POINT_DTYPE.names[4:10], upper.T, strict=True):  # type: ignore[index]
            rows[name] = column
        rows["sigma_m"] = np.sqrt(np.maximum(upper[:, [0, 3, 5]].sum(axis=1), 0))
    rows["track_id"] = np.asarray(track_ids, dtype=np.int64) & 0xFFFFFFFF
    message = PointCloud(frame_id=frame_id, point_stride=POINT_DTYPE.itemsize, data=rows.tobytes())
    message.pose.orientation.w = 1.0
    _set_time(message.timestamp, stamp_ns)
    for name in POINT_DTYPE.names or ():
        kind = PackedElementField.UINT32 if name == "track_id" else PackedElementField.FLOAT32
        message.fields.add(name=name, offset=POINT_DTYPE.fields[name][1], type=kind)  # type: ignore[index]
    data: bytes = message.SerializeToString(deterministic=True)
    return data


def _set_time(timestamp: Any, stamp_ns: int) -> None:
    timestamp.seconds, timestamp.nanos = divmod(stamp_ns, 10**9)


def _set_pose(position: Any, orientation: Any, pose: Array) -> None:
    position.x, position.y, position.z = pose[:3, 3]
    orientation.x, orientation.y, orientation.z, orientation.w = se3.quat_xyzw_from_matrix(pose[:3, :3])
