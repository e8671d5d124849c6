"""Writes `estimates.mcap`: everything a run estimates, as a bag that ROS 2, Foxglove, Rerun and PlotJuggler open.

| topic | message | content |
|---|---|---|
| /stream_sfm/odometry | nav_msgs/msg/Odometry | the path that never jumps, and the velocity, with covariances |
| /stream_sfm/pose | geometry_msgs/msg/PoseWithCovarianceStamped | the best estimate of the pose in the world |
| /tf | tf2_msgs/msg/TFMessage | the odom frame in the world, and the camera or robot in the odom frame |
| /tf_static | tf2_msgs/msg/TFMessage | the camera on the robot, once, if there is a base frame |
| /stream_sfm/path | nav_msgs/msg/Path | the positions so far, less often as it grows |
| /stream_sfm/points | sensor_msgs/msg/PointCloud2 | CC local structure in the camera frame, one message per frame |
| /stream_sfm/map | sensor_msgs/msg/PointCloud2 | WC structure: points that left the estimator, each once |
| /stream_sfm/scalars | stream_sfm_msgs/msg/Scalars | numbers to plot |
| /stream_sfm/estimate | stream_sfm_msgs/msg/Estimate | status, pose, covariance, window, counts |
| /stream_sfm/timing | stream_sfm_msgs/msg/Timing | milliseconds per stage |

All are CDR, because ROS 2 plays no bag that mixes serialisations. Frames and axes follow the settings `[ros]`;
/stream_sfm/estimate does not: its pose is always that of the left camera, in the first one.

Metadata `stream_sfm` (software_version, schema_version, method) and `configuration` (config.toml); attachment
`calibration.toml`. All times of a message are the frame's stamp, its sequence the frame index; two runs differ
in /stream_sfm/timing only. A chunk is closed at the latest after half a second of log time or 20 frames, and the
file is moved to its name by `close`: a process that is killed leaves all but the last chunk in `<name>.part`,
which `read_estimates` reads.
"""

from collections import Counter
from pathlib import Path
from typing import IO, Any, cast

import mcap
import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from numpy.typing import NDArray

from .. import __version__
from ..camera.rig import MonoRig, StereoRig
from ..config import Config, config_to_toml
from ..errors import OutputError
from ..files import PartFile
from ..geometry.se3 import Array
from ..motion import Odometry
from ..types import Frame, FrameEstimate
from . import ros_messages
from .bag_metadata import bag_metadata
from .frames import RosFrames, fixed_axis_covariance
from .path import PathSoFar
from .scalars import Scalars
from .schema import SCHEMA_VERSION, EstimateRecord, ScalarsRecord, TimingRecord, estimate_record

_CHUNK_NS = 500_000_000  # a chunk is closed after this much log time: what a killed process loses at most
_CHUNK_FRAMES = 20  # and after this many frames, at the latest
_CHUNK_BYTES = 4 * 2**20  # and at this size; never reached by 20 frames of 200 points
_TOPICS = {
    "/stream_sfm/odometry": ros_messages.ODOMETRY,
    "/stream_sfm/pose": ros_messages.POSE,
    "/tf": ros_messages.TRANSFORMS,
    "/tf_static": ros_messages.TRANSFORMS,
    "/stream_sfm/path": ros_messages.PATH,
    "/stream_sfm/points": ros_messages.CLOUD,
    "/stream_sfm/map": ros_messages.CLOUD,
    "/stream_sfm/scalars": ros_messages.RECORDS[ScalarsRecord],
    "/stream_sfm/estimate": ros_messages.RECORDS[EstimateRecord],
    "/stream_sfm/timing": ros_messages.RECORDS[TimingRecord],
}
# Quality of service of /tf_static, without which subscribers do not get a message from before their time. The numbers
# are those of ROS's enumerations: keep last, reliable, transient local, automatic. All versions of ROS 2 read them.
_LATCHED = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""


class EstimatesWriter:
    """A sink that writes estimates. Raises OutputError where the file cannot be written."""

    def __init__(self, path: str | Path, rig: StereoRig | MonoRig, config: Config) -> None:
        self._frames = RosFrames(config.ros)
        self._path, self._scalars = PathSoFar(), Scalars()
        self._file = PartFile(path)
        self._writer = Writer(cast(IO[Any], self._file), chunk_size=_CHUNK_BYTES)
        self._writer.start("ros2", library=f"stream_sfm {__version__}, mcap {mcap.__version__}")
        about = {"software_version": __version__, "schema_version": str(SCHEMA_VERSION), "method": config.method}
        self._writer.add_metadata("stream_sfm", about | {"unscaled": str(rig.unscaled).lower()})
        self._writer.add_metadata("configuration", {"config.toml": config_to_toml(config)})
        self._writer.add_attachment(0, 0, "calibration.toml", "application/toml", rig.to_toml().encode())
        self._counts: Counter[str] = Counter()
        self._times_ns = (0, 0)  # of the first and the last message
        self._channels = self._register()
        self._writer.flush()
        self._chunk_began_ns = 0
        self._frames_in_chunk = 0
        self._odometry: Odometry | None = None
        self._closed = False

    def _register(self) -> dict[str, int]:
        topics = {
            t: name for t, name in _TOPICS.items() if t != "/tf_static" or self._frames.base_from_cam is not None
        }
        schemas = {
            name: self._writer.register_schema(name, SchemaEncoding.ROS2, ros_messages.schema_text(name).encode())
            for name in dict.fromkeys(topics.values())
        }
        register, cdr = self._writer.register_channel, MessageEncoding.CDR
        return {
            t: register(t, cdr, schemas[name], {"offered_qos_profiles": _quality(t)}) for t, name in topics.items()
        }

    def write(self, estimate: FrameEstimate, frame: Frame | None = None) -> None:
        """Append all messages of one frame."""
        stamp, frames = estimate.stamp_ns, self._frames
        if self._frames_in_chunk == 0:
            self._chunk_began_ns = stamp
        if self._odometry is None and frames.base_from_cam is not None:
            head, mounting = ros_messages.header(stamp, frames.moving), ros_messages.pose_of(frames.base_from_cam)
            self._add(estimate, "/tf_static", ros_messages.transforms((head, frames.camera, mounting)))
        self._add_pose(estimate)
        in_cam = estimate.track_ids, estimate.points_in_cam, estimate.cov_points
        head = ros_messages.header(stamp, frames.camera)
        self._add(estimate, "/stream_sfm/points", ros_messages.cloud(head, *in_cam))
        if len(estimate.ended_ids):
            ended = estimate.ended_points_in_world, estimate.ended_cov_points_in_world
            self._add_map(estimate, estimate.ended_ids, *ended)
        timing = TimingRecord(frame_index=estimate.frame_index, timings_ms=dict(estimate.timings_ms))
        self._add(estimate, "/stream_sfm/estimate", ros_messages.record(head, estimate_record(estimate)))
        self._add(estimate, "/stream_sfm/timing", ros_messages.record(head, timing))
        self._frames_in_chunk += 1
        if self._frames_in_chunk >= _CHUNK_FRAMES or abs(stamp - self._chunk_began_ns) >= _CHUNK_NS:
            self._writer.flush()
            self._frames_in_chunk = 0

    def close(self) -> None:
        """Add the whole path, and the points still visible to the map; finish the file and move it into place."""
        if self._closed:
            return
        self._closed = True
        try:
            if self._odometry is not None:
                last = self._odometry.estimate
                self._add_path(last)
                if len(last.track_ids):
                    self._add_map(last, last.track_ids, last.points_in_world, last.cov_points_in_world)
            self._writer.finish()
        except OutputError:
            self._file.close()  # raises the same error
            raise
        self._file.close()

    def metadata(self) -> bytes:
        """Return the content of metadata.yaml, which makes the folder of the file a bag."""
        topics = {topic: (_TOPICS[topic], _quality(topic), self._counts[topic]) for topic in self._channels}
        return bag_metadata(self._file.path.name, topics, *self._times_ns)

    def _add_pose(self, estimate: FrameEstimate) -> None:
        """Add every message that states the pose of the moving frame, camera or robot."""
        frames = self._frames
        head = ros_messages.header(estimate.stamp_ns, frames.world)
        fixed_from_moving = frames.pose(estimate.world_from_cam)
        pose = ros_messages.pose_of(fixed_from_moving)
        covariance = fixed_axis_covariance(fixed_from_moving[:3, :3], frames.cov_pose(estimate.cov_pose))
        self._add(estimate, "/stream_sfm/pose", ros_messages.pose_with_covariance(head, pose, covariance))
        self._odometry = odometry = Odometry.after(self._odometry, estimate)
        self._add_odometry(odometry)
        scalars = self._scalars.of(odometry, fixed_from_moving, covariance)
        self._add(estimate, "/stream_sfm/scalars", ros_messages.record(head, scalars))
        if self._path.add(ros_messages.pose_stamped(head, pose)):
            self._add_path(estimate)

    def _add_odometry(self, odometry: Odometry) -> None:
        """Add the continuous path, and the transforms by which the camera is in the world."""
        frames, estimate = self._frames, odometry.estimate
        world, odom = (ros_messages.header(estimate.stamp_ns, name) for name in (frames.world, frames.odom))
        odom_from_moving = frames.pose(odometry.odom_from_cam)
        pose = ros_messages.pose_of(odom_from_moving)
        covariance = fixed_axis_covariance(odom_from_moving[:3, :3], frames.cov_pose(odometry.cov))
        twist, cov_twist = odometry.twist, odometry.cov_twist
        if twist is not None and cov_twist is not None:
            twist, cov_twist = frames.twist(twist), frames.cov_pose(cov_twist)
        moving = ros_messages.odometry(odom, frames.moving, pose, covariance, twist, cov_twist)
        self._add(estimate, "/stream_sfm/odometry", moving)
        world_from_odom = ros_messages.pose_of(frames.between(odometry.world_from_odom))
        transforms = ros_messages.transforms((world, frames.odom, world_from_odom), (odom, frames.moving, pose))
        self._add(estimate, "/tf", transforms)

    def _add_path(self, estimate: FrameEstimate) -> None:
        head = ros_messages.header(estimate.stamp_ns, self._frames.world)
        self._add(estimate, "/stream_sfm/path", ros_messages.path(head, self._path.poses()))

    def _add_map(self, estimate: FrameEstimate, ids: NDArray[np.int64], points_in_world: Array, cov: Array) -> None:
        head = ros_messages.header(estimate.stamp_ns, self._frames.world)
        in_fixed = self._frames.points(points_in_world, cov)
        self._add(estimate, "/stream_sfm/map", ros_messages.cloud(head, ids, *in_fixed))

    def _add(self, estimate: FrameEstimate, topic: str, message: Any) -> None:
        stamp = max(estimate.stamp_ns, 0)  # MCAP's times are unsigned
        data = ros_messages.encode(message)
        self._writer.add_message(self._channels[topic], stamp, data, stamp, estimate.frame_index)
        first_ns, last_ns = self._times_ns if self._counts else (stamp, stamp)
        self._times_ns = min(first_ns, stamp), max(last_ns, stamp)
        self._counts[topic] += 1


def _quality(topic: str) -> str:
    return _LATCHED if topic == "/tf_static" else ""
