"""Estimates as ROS 2 messages, in the frames and axes of the settings `[ros]`: for `estimates.mcap`, and for a node."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import RosConfig
from ..geometry import Array, se3
from ..motion import Odometry
from ..types import FrameEstimate, Status
from . import ros_messages as ros
from .frames import RosFrames, fixed_axis_covariance
from .own_messages import ESTIMATE, SCALARS, TIMING, estimate_fields, named

TOPICS = {
    "/stream_sfm/odometry": ros.ODOMETRY,
    "/stream_sfm/pose": ros.POSE,
    "/tf": ros.TRANSFORMS,
    "/tf_static": ros.TRANSFORMS,
    "/stream_sfm/path": ros.PATH,
    "/stream_sfm/points": ros.CLOUD,
    "/stream_sfm/map": ros.CLOUD,
    "/stream_sfm/scalars": SCALARS,
    "/stream_sfm/estimate": ESTIMATE,
    "/stream_sfm/timing": TIMING,
}
_LEVELS = {Status.OK: 0, Status.INITIALISING: 0, Status.DEGRADED: 1, Status.LOST: 2}  # of diagnostic_msgs
_MAX_POSES = 4096  # per path message; beyond it every other pose is dropped
Stamped = Iterator[tuple[str, Any]]  # topic and message


class RosMessages:
    """Makes messages from estimates in order: for `estimates.mcap`, or for a node that publishes them.

    `topics`: the types of the messages by topic. Messages have the fields of ROS 2. `map_from_world` (4, 4):
    the current pose of the world of the estimates in a map of places; messages in the world frame follow it or,
    with `ros.gravity`, the current estimate of the up direction.
    """

    def __init__(self, ros: RosConfig, map_from_world: Callable[[], Array] | None = None) -> None:
        self._frames = RosFrames(ros)
        self._gravity = ros.gravity and map_from_world is None
        self._level, self._cov_level = np.eye(4), np.zeros((6, 6))  # rotation of the world by the current gravity
        self._map_from_world = map_from_world or (lambda: self._level)
        self._path, self._path_length = PathSoFar(), 0.0
        self._odometry: Odometry | None = None
        on_robot = self._frames.base_from_cam is not None
        self.topics = {topic: kind for topic, kind in TOPICS.items() if on_robot or topic != "/tf_static"}

    def of(self, estimate: FrameEstimate) -> Stamped:
        """Yield topic and message of everything in an estimate; first also the pose of the camera on the robot."""
        stamp, frames, e = estimate.stamp_ns, self._frames, estimate
        if self._odometry is None and frames.base_from_cam is not None:
            mounting = ros.header(stamp, frames.moving), frames.camera, ros.pose_of(frames.base_from_cam)
            yield "/tf_static", ros.transforms(mounting)
        cov_pose = self._upright_cov_pose(e) if self._gravity else e.cov_pose
        yield from self._pose(e, cov_pose)
        head = ros.header(stamp, frames.camera)
        yield "/stream_sfm/points", ros.cloud(head, e.track_ids, e.points_in_cam, e.cov_points)
        if len(e.ended_ids):
            yield self._map(e, e.ended_ids, e.ended_points_in_world, e.ended_cov_points_in_world)
        yield "/stream_sfm/estimate", ros.make(ESTIMATE, header=head, **estimate_fields(e))
        timings = named("timings_ms", e.timings_ms)
        yield "/stream_sfm/timing", ros.make(TIMING, header=head, frame_index=e.frame_index, **timings)

    def encode(self, message: Any) -> bytes:
        """Return the bytes of a message in CDR, as ROS 2 sends them."""
        return ros.encode([message])[0]

    def world_from_cam(self, pose: Array) -> Array:
        """Return the pose of the camera (4, 4), as `Engine.reset` takes it, from a ROS pose of robot or camera."""
        return self._frames.pose_of_camera(pose)

    @property
    def last(self) -> FrameEstimate | None:
        """The estimate that was given last."""
        return None if self._odometry is None else self._odometry.estimate

    def end(self) -> Stamped:
        """Yield what remains after the last frame: the whole path, and the map points that are still in view."""
        if (last := self.last) is not None:
            yield self._path_now(ros.header(last.stamp_ns, self._frames.world))
            if len(last.track_ids):
                yield self._map(last, last.track_ids, last.points_in_world, last.cov_points_in_world)

    def diagnostics(self, estimate: FrameEstimate, counts: Mapping[str, int] | None = None) -> Any:
        """Make a DiagnosticArray of the status of a frame, with further counts by name."""
        values = {**estimate.counts, "frame": estimate.frame_index, **(counts or {})}
        pairs = [ros.make("diagnostic_msgs/msg/KeyValue", key=k, value=str(v)) for k, v in values.items()]
        status = ros.make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=_LEVELS[estimate.status],
            name="stream_sfm: odometry",
            message=f"{estimate.status}: {estimate.reason}" if estimate.reason else str(estimate.status),
            hardware_id=self._frames.camera,
            values=pairs,
        )
        head = ros.header(estimate.stamp_ns, self._frames.camera)
        return ros.make("diagnostic_msgs/msg/DiagnosticArray", header=head, status=[status])

    def _upright_cov_pose(self, estimate: FrameEstimate) -> Array:
        """Level the world by the gravity of a frame, if available, and return the covariance of its pose there."""
        if (found := estimate.upright(self._frames.fixed_from_world)) is not None:
            self._level = se3.inverse(self._frames.fixed_from_world) @ found.upright_from_world
            self._cov_level = found.cov
            return found.cov_pose
        to_cam = se3.adjoint(se3.inverse(estimate.world_from_cam))  # lost, or before the first samples
        return np.asarray(estimate.cov_pose + to_cam @ self._cov_level @ to_cam.T)

    def _pose(self, estimate: FrameEstimate, cov_pose: Array) -> Stamped:
        """Yield the messages with the pose of the moving frame, camera or robot: in the world, and on its own path."""
        frames = self._frames
        self._odometry = now = Odometry.after(self._odometry, estimate)
        head, odom = ros.header(estimate.stamp_ns, frames.world), ros.header(estimate.stamp_ns, frames.odom)
        in_map = self._map_from_world()
        pose, cov = frames.pose(in_map @ estimate.world_from_cam), frames.cov_pose(cov_pose)
        message, covariance = ros.pose_of(pose), fixed_axis_covariance(pose[:3, :3], cov)
        yield "/stream_sfm/pose", ros.make(ros.POSE, header=head, pose=ros.with_covariance(message, covariance))
        on_path = frames.pose(now.odom_from_cam)
        moved = ros.pose_of(on_path)
        stated = ros.with_covariance(moved, fixed_axis_covariance(on_path[:3, :3], frames.cov_pose(now.cov)))
        twist, cov_twist = now.twist, now.cov_twist
        if twist is not None and cov_twist is not None:
            twist, cov_twist = frames.twist(twist), frames.cov_pose(cov_twist)
        yield "/stream_sfm/odometry", ros.odometry(odom, frames.moving, stated, twist, cov_twist)
        corrected = ros.pose_of(frames.between(in_map @ now.world_from_odom))
        yield "/tf", ros.transforms((head, frames.odom, corrected), (odom, frames.moving, moved))
        yield "/stream_sfm/scalars", ros.make(SCALARS, header=head, **self._numbers(now, pose, covariance))
        if self._path.add(ros.make("geometry_msgs/msg/PoseStamped", header=head, pose=message)):
            yield self._path_now(head)

    def _numbers(self, odometry: Odometry, pose: Array, covariance: Array) -> dict[str, float]:
        """Return the numbers to plot of a frame whose pose (4, 4) in the world has ROS's covariance (6, 6)."""
        estimate, moved, seconds = odometry.estimate, odometry.from_previous, odometry.seconds or np.nan
        distance = float(np.linalg.norm(moved[:3, 3]))
        self._path_length += distance
        variances = np.diag(covariance)
        with np.errstate(invalid="ignore"):
            std = np.sqrt([*variances[:3], variances[:3].sum(), variances[3:].sum()]).tolist()
        names = ("x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "sigma_position")
        return {
            **dict(zip(names, [*pose[:3, 3].tolist(), *std[:4]], strict=True)),
            "sigma_rotation_deg": np.degrees(std[4]),
            "speed": distance / seconds,
            "angular_speed_deg_s": np.degrees(np.linalg.norm(se3.log_so3(moved[:3, :3]))) / seconds,
            "path_length": self._path_length,
            **{f"points_{name}": estimate.counts.get(name, 0) for name in ("tracked", "new", "used", "rejected")},
            "nis_per_dof": estimate.nis / estimate.nis_dof if estimate.nis_dof else np.nan,
            "status": tuple(Status).index(estimate.status),
        }

    def _path_now(self, head: Any) -> tuple[str, Any]:
        return "/stream_sfm/path", ros.make(ros.PATH, header=head, poses=self._path.poses())

    def _map(self, estimate: FrameEstimate, ids: NDArray[Any], points_in_world: Array, cov: Array) -> tuple[str, Any]:
        head, in_map = ros.header(estimate.stamp_ns, self._frames.world), self._map_from_world()
        moved = se3.transform(in_map, points_in_world), in_map[:3, :3] @ cov @ in_map[:3, :3].T
        return "/stream_sfm/map", ros.cloud(head, ids, *self._frames.points(*moved))


class PathSoFar:
    """Collects the poses of all frames in bounded memory; a long path is thinned.

    A path is due with the first poses, and whenever it is a twentieth longer.
    """

    def __init__(self) -> None:
        self._kept: list[Any] = []
        self._latest: Any = None
        self._frames = 0
        self._stride = 1
        self._due_at = 1.0

    def add(self, pose: Any) -> bool:
        """Add the next pose, and return whether a path is due."""
        if self._frames % self._stride == 0:
            if len(self._kept) == _MAX_POSES:  # an even number: this frame is also among the thinned ones
                del self._kept[1::2]
                self._stride *= 2
            self._kept.append(pose)
        self._latest = pose
        self._frames += 1
        if self._frames < self._due_at:
            return False
        self._due_at = 1.05 * self._frames
        return True

    def poses(self) -> list[Any]:
        """Return the path, from the first pose to the latest."""
        if not self._kept or self._kept[-1] is self._latest:
            return list(self._kept)
        return [*self._kept, self._latest]
