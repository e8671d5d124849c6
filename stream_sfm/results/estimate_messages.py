"""Estimates as ROS 2 messages, in the frames and axes of the settings `[ros]`: for `estimates.mcap`, and for a node."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import RosConfig
from ..geometry import se3
from ..geometry.se3 import Array
from ..motion import Odometry
from ..types import FrameEstimate, Status
from . import cdr, ros_messages
from .frames import RosFrames, fixed_axis_covariance
from .own_messages import ESTIMATE, SCALARS, TIMING, estimate_fields, named

TOPICS = {
    "/stream_sfm/odometry": ros_messages.ODOMETRY,
    "/stream_sfm/pose": ros_messages.POSE,
    "/tf": ros_messages.TRANSFORMS,
    "/tf_static": ros_messages.TRANSFORMS,
    "/stream_sfm/path": ros_messages.PATH,
    "/stream_sfm/points": ros_messages.CLOUD,
    "/stream_sfm/map": ros_messages.CLOUD,
    "/stream_sfm/scalars": SCALARS,
    "/stream_sfm/estimate": ESTIMATE,
    "/stream_sfm/timing": TIMING,
}
_LEVELS = {Status.OK: 0, Status.INITIALISING: 0, Status.DEGRADED: 1, Status.LOST: 2}  # of diagnostic_msgs
_DEGREES = 180 / np.pi
_MAX_POSES = 4096  # of the path in one message; beyond it every other pose is dropped
_GROWTH = 1.05  # the path is published again when it is 5 % longer
Stamped = Iterator[tuple[str, Any]]  # topic and message


class RosMessages:
    """Makes the messages of a run's estimates, given in order: for `estimates.mcap`, or for a node that publishes them.

    `topics`: the types of the messages by topic. Messages have the fields that ROS 2 gives them. `map_from_world`:
    where a map of places has the world of the estimates by now (4, 4); what is said in the world frame follows it.
    """

    def __init__(self, ros: RosConfig, map_from_world: Callable[[], Array] | None = None) -> None:
        self._frames = RosFrames(ros)
        self._map_from_world = map_from_world
        self._path, self._path_length = PathSoFar(), 0.0
        self._odometry: Odometry | None = None
        self.topics = {
            t: name for t, name in TOPICS.items() if t != "/tf_static" or self._frames.base_from_cam is not None
        }

    def of(self, estimate: FrameEstimate) -> Stamped:
        """Yield topic and message of all that a frame tells; with the first one, where the camera is on the robot."""
        stamp, frames = estimate.stamp_ns, self._frames
        if self._odometry is None and frames.base_from_cam is not None:
            head, mounting = ros_messages.header(stamp, frames.moving), ros_messages.pose_of(frames.base_from_cam)
            yield "/tf_static", ros_messages.transforms((head, frames.camera, mounting))
        yield from self._pose(estimate)
        in_cam = estimate.track_ids, estimate.points_in_cam, estimate.cov_points
        head = ros_messages.header(stamp, frames.camera)
        yield "/stream_sfm/points", ros_messages.cloud(head, *in_cam)
        if len(estimate.ended_ids):
            ended = estimate.ended_points_in_world, estimate.ended_cov_points_in_world
            yield self._map(estimate, estimate.ended_ids, *ended)
        timings = named("timings_ms", estimate.timings_ms)
        yield "/stream_sfm/estimate", cdr.make(ESTIMATE, header=head, **estimate_fields(estimate))
        yield (
            "/stream_sfm/timing",
            cdr.make(TIMING, header=head, frame_index=estimate.frame_index, **timings),
        )

    def encode(self, message: Any) -> bytes:
        """Return the bytes of a message in CDR, as ROS 2 sends them."""
        return cdr.encode(message)

    @property
    def last(self) -> FrameEstimate | None:
        """The estimate that was given last."""
        return None if self._odometry is None else self._odometry.estimate

    def end(self) -> Stamped:
        """Yield what the last frame leaves to be told: the whole path, and the map's points that are still in view."""
        if (last := self.last) is not None:
            yield self._path_now(last)
            if len(last.track_ids):
                yield self._map(last, last.track_ids, last.points_in_world, last.cov_points_in_world)

    def diagnostics(self, estimate: FrameEstimate) -> Any:
        """Make a DiagnosticArray of the status of a frame."""
        values = {**estimate.counts, "frame": estimate.frame_index}
        pairs = [cdr.make("diagnostic_msgs/msg/KeyValue", key=k, value=str(v)) for k, v in values.items()]
        status = cdr.make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=_LEVELS[estimate.status],
            name="stream_sfm: odometry",
            message=f"{estimate.status}: {estimate.reason}" if estimate.reason else str(estimate.status),
            hardware_id=self._frames.camera,
            values=pairs,
        )
        head = ros_messages.header(estimate.stamp_ns, self._frames.camera)
        return cdr.make("diagnostic_msgs/msg/DiagnosticArray", header=head, status=[status])

    def _pose(self, estimate: FrameEstimate) -> Stamped:
        """Every message that states the pose of the moving frame, camera or robot."""
        frames = self._frames
        head = ros_messages.header(estimate.stamp_ns, frames.world)
        fixed_from_moving = frames.pose(self._in_map() @ estimate.world_from_cam)
        pose = ros_messages.pose_of(fixed_from_moving)
        covariance = fixed_axis_covariance(fixed_from_moving[:3, :3], frames.cov_pose(estimate.cov_pose))
        stated = {"pose": pose, "covariance": covariance}
        yield "/stream_sfm/pose", cdr.make(ros_messages.POSE, header=head, pose=stated)
        self._odometry = odometry = Odometry.after(self._odometry, estimate)
        yield from self._moving(odometry)
        numbers = self._numbers(odometry, fixed_from_moving, covariance)
        yield "/stream_sfm/scalars", cdr.make(SCALARS, header=head, **numbers)
        if self._path.add(cdr.make("geometry_msgs/msg/PoseStamped", header=head, pose=pose)):
            yield self._path_now(estimate)

    def _numbers(self, odometry: Odometry, pose: Array, covariance: Array) -> dict[str, float]:
        """The numbers to plot of a frame whose pose (4, 4) in the world has ROS's covariance (6, 6)."""
        estimate, moved, seconds = odometry.estimate, odometry.from_previous, odometry.seconds or np.nan
        distance = float(np.linalg.norm(moved[:3, 3]))
        self._path_length += distance
        variances = np.diag(covariance)
        with np.errstate(invalid="ignore"):
            sigmas = np.sqrt([*variances[:3], variances[:3].sum(), variances[3:].sum()])
        return {
            **dict(zip("xyz", pose[:3, 3].tolist(), strict=True)),
            **dict(zip(("sigma_x", "sigma_y", "sigma_z", "sigma_position"), sigmas.tolist(), strict=False)),
            "sigma_rotation_deg": sigmas[4] * _DEGREES,
            "speed": distance / seconds,
            "angular_speed_deg_s": np.linalg.norm(se3.log_so3(moved[:3, :3])) * _DEGREES / seconds,
            "path_length": self._path_length,
            **{f"points_{name}": estimate.counts.get(name, 0) for name in ("tracked", "new", "used", "rejected")},
            "nis_per_dof": estimate.nis / estimate.nis_dof if estimate.nis_dof else np.nan,
            "status": tuple(Status).index(estimate.status),
        }

    def _moving(self, odometry: Odometry) -> Stamped:
        """The continuous path, and the transforms by which the camera is in the world."""
        frames, estimate = self._frames, odometry.estimate
        world, odom = (ros_messages.header(estimate.stamp_ns, name) for name in (frames.world, frames.odom))
        odom_from_moving = frames.pose(odometry.odom_from_cam)
        pose = ros_messages.pose_of(odom_from_moving)
        covariance = fixed_axis_covariance(odom_from_moving[:3, :3], frames.cov_pose(odometry.cov))
        twist, cov_twist = odometry.twist, odometry.cov_twist
        if twist is not None and cov_twist is not None:
            twist, cov_twist = frames.twist(twist), frames.cov_pose(cov_twist)
        yield "/stream_sfm/odometry", ros_messages.odometry(odom, frames.moving, pose, covariance, twist, cov_twist)
        world_from_odom = ros_messages.pose_of(frames.between(self._in_map() @ odometry.world_from_odom))
        yield "/tf", ros_messages.transforms((world, frames.odom, world_from_odom), (odom, frames.moving, pose))

    def _path_now(self, estimate: FrameEstimate) -> tuple[str, Any]:
        head = ros_messages.header(estimate.stamp_ns, self._frames.world)
        return "/stream_sfm/path", cdr.make(ros_messages.PATH, header=head, poses=self._path.poses())

    def _map(
        self, estimate: FrameEstimate, ids: NDArray[Any], points_in_world: Array, cov: Array
    ) -> tuple[str, Any]:
        head, here = ros_messages.header(estimate.stamp_ns, self._frames.world), self._in_map()
        moved = se3.transform(here, points_in_world), here[:3, :3] @ cov @ here[:3, :3].T
        return "/stream_sfm/map", ros_messages.cloud(head, ids, *self._frames.points(*moved))

    def _in_map(self) -> Array:
        return np.eye(4) if self._map_from_world is None else self._map_from_world()


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
            if len(self._kept) == _MAX_POSES:  # an even number: this frame belongs to the thinned ones, too
                del self._kept[1::2]
                self._stride *= 2
            self._kept.append(pose)
        self._latest = pose
        self._frames += 1
        if self._frames < self._due_at:
            return False
        self._due_at = self._frames * _GROWTH
        return True

    def poses(self) -> list[Any]:
        """Return the path, from the first pose to the latest."""
        if not self._kept or self._kept[-1] is self._latest:
            return list(self._kept)
        return [*self._kept, self._latest]
