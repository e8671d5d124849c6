"""The work of the node without ROS: messages of a stereo camera in, messages of the estimates out.

Input is anything with the fields of sensor_msgs; output is bytes in CDR, which publishers of rclpy take.
One thread may put images while another takes messages.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import stream_sfm as sfm

DIAGNOSTICS = "/diagnostics"


class StereoOdometry:
    """The engine behind the node. `settings`: `section.key=value`, as `stream-sfm replay --set` takes them.

    `config` and `calibration` are files, or empty; without a calibration it is that of the first camera infos.
    `rectified`: the images are those of image_rect, so that P counts instead of K, D and R.
    """

    def __init__(
        self, settings: Sequence[str] = (), config: str = "", calibration: str = "", rectified: bool = False
    ) -> None:
        self.config = sfm.read_config(config or None, [text for text in settings if text])
        self.messages = sfm.RosMessages(self.config.ros)
        self.rectified = rectified
        self.engine: sfm.Engine | None = None
        self.images: sfm.RosImages | None = None
        self._wanted: list[np.ndarray | None] = []  # poses of resets that have been asked for
        self._infos: dict[int, tuple[tuple[Any, ...], Any]] = {}  # by side, their numbers and the message
        self._changed: sfm.StereoRig | None = None  # other cameras than those of the engine
        self._world_from_cam = np.eye(4)  # the latest one
        self._calibrated = bool(calibration)
        if calibration:
            self.begin(sfm.StereoRig.from_calibration(calibration))

    @property
    def topics(self) -> dict[str, str]:
        """Topics that the node publishes, and the types of their messages: those that every ROS 2 has."""
        standard = {topic: kind for topic, kind in self.messages.topics.items() if not kind.startswith("stream_sfm")}
        return standard | {DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray"}

    def begin(self, rig: sfm.StereoRig) -> None:
        """Make the engine for these cameras; images that came before are not used. Raises ConfigError."""
        self.engine, self.images = sfm.Engine(rig, self.config), sfm.RosImages(rig)

    def calibrate(self, side: int, info: Any) -> None:
        """Take a camera info, unless a file has calibrated the cameras; another one begins a new map at the last pose.

        Raises ConfigError if both together are no calibration; the cameras then stay as they were.
        """
        numbers = (info.width, info.height, info.distortion_model, *map(tuple, (info.d, info.k, info.r, info.p)))
        if self._calibrated or (side in self._infos and self._infos[side][0] == numbers):
            return
        self._infos[side] = numbers, info
        if len(self._infos) == 2:
            rig = rig_of(self._infos[0][1], self._infos[1][1], self.rectified)
            if self.engine is None:
                self.begin(rig)
            else:
                self._changed = rig

    def put(self, side: int, image: Any) -> None:
        """Take an image of the left (0) or right (1) camera. Raises FrameError for one that cannot be used."""
        if self.images is not None:
            self.images.put(side, image)

    def reset(self, pose: Any = None) -> None:
        """Begin anew with the next pair; `pose`: a geometry_msgs/Pose of robot or camera in the world frame then."""
        world_from_cam = None
        if pose is not None:
            p, q = pose.position, pose.orientation
            turn, world_from_moving = np.array([q.x, q.y, q.z]), np.eye(4)
            half = np.arctan2(np.linalg.norm(turn), q.w)
            rotation = 2 * half * turn / max(float(np.linalg.norm(turn)), 1e-12)
            world_from_moving[:3, :3] = sfm.se3_exp(np.r_[0, 0, 0, rotation])[:3, :3]
            world_from_moving[:3, 3] = p.x, p.y, p.z
            world_from_cam = self.messages.world_from_cam(world_from_moving)
        if self.images is not None:
            self.images.clear()  # they may be of before a clock was set back
        self._wanted.append(world_from_cam)

    def take(self, timeout_s: float | None = None) -> Iterator[tuple[str, bytes]]:
        """Wait for a pair and estimate it; yield topics and messages, none after a time without a pair.

        Raises FrameError.
        """
        if self.engine is None or self.images is None:
            return
        self._begin_if_changed()
        self._reset_if_wanted()
        frame = self.images.take(timeout_s)
        if frame is None or (self._reset_if_wanted() and not self.images.is_current):
            return
        estimate = self.engine.step(frame)
        self._world_from_cam = estimate.world_from_cam
        for topic, message in self.messages.of(estimate):
            if topic in self.topics:
                yield topic, self.messages.encode(message)
        counts = {"dropped": self.images.dropped, "unpaired": self.images.unpaired}
        yield DIAGNOSTICS, self.messages.encode(self.messages.diagnostics(estimate, counts))

    def _begin_if_changed(self) -> None:
        """Go on with other cameras in the thread of the engine: a new map, in the same world."""
        rig, self._changed = self._changed, None
        if rig is not None:
            self.begin(rig)
            self._wanted.insert(0, self._world_from_cam)

    def _reset_if_wanted(self) -> bool:
        """Do a requested `reset` in the thread of the engine; return whether there was one."""
        wanted = bool(self._wanted)
        while self._wanted and self.engine is not None:
            self.engine.reset(self._wanted.pop(0))
            self.messages = sfm.RosMessages(self.config.ros)
        return wanted


def rig_of(left: Any, right: Any, rectified: bool = False) -> sfm.StereoRig:
    """The rig of two sensor_msgs/CameraInfo. Raises ConfigError if the cameras are not calibrated."""
    cameras, rotations = [], []
    for info in (left, right):
        k, p = np.reshape(info.k, (3, 3)), np.reshape(info.p, (3, 4))
        if not k[0, 0] or not p[0, 0]:
            raise sfm.ConfigError(
                "the camera infos hold no calibration: calibrate the pair, or name a calibration file"
            )
        lens = ("none", ()) if rectified else (info.distortion_model, tuple(info.d))
        cameras.append(
            sfm.Camera(info.width, info.height, p[:, :3] if rectified else k, lens[1], lens[0] or "plumb_bob")
        )
        rotations.append(np.eye(3) if rectified else np.reshape(info.r, (3, 3)))
    p = np.reshape(right.p, (3, 4))
    pose = np.eye(4)
    pose[:3, :3] = rotations[1].T @ rotations[0]
    pose[:3, 3] = rotations[1].T @ [p[0, 3] / p[0, 0], 0, 0]
    return sfm.StereoRig(cameras[0], cameras[1], pose)
