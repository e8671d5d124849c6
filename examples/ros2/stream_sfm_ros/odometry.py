"""All that the node does, without ROS: messages of a stereo camera in, messages of the estimates out.

Messages in are anything with the fields of sensor_msgs; messages out are bytes in CDR, which publishers of rclpy take.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import stream_sfm as sfm

DIAGNOSTICS = "/diagnostics"
_CHANNELS = {
    "mono8": 1,
    "8UC1": 1,
    "mono16": 1,
    "16UC1": 1,
    "bgr8": 3,
    "8UC3": 3,
    "rgb8": 3,
    "bgra8": 4,
    "rgba8": 4,
}


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
        if calibration:
            self.engine = sfm.Engine(sfm.StereoRig.from_calibration(calibration), self.config)

    @property
    def topics(self) -> dict[str, str]:
        """Topics that the node publishes, and the types of their messages: those that every ROS 2 has."""
        standard = {
            topic: kind for topic, kind in self.messages.topics.items() if not kind.startswith("stream_sfm")
        }
        return standard | {DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray"}

    def frame(self, left: Any, right: Any, left_info: Any, right_info: Any) -> Iterator[tuple[str, bytes]]:
        """Estimate one pair of images; yield topics and messages. Raises FrameError, ConfigError."""
        if self.engine is None:
            self.engine = sfm.Engine(rig_of(left_info, right_info, self.rectified), self.config)
        stamp_ns = left.header.stamp.sec * 10**9 + left.header.stamp.nanosec
        estimate = self.engine.step(sfm.StereoFrame(stamp_ns, image_of(left), image_of(right)))
        for topic, message in self.messages.of(estimate):
            if topic in self.topics:
                yield topic, self.messages.encode(message)
        yield DIAGNOSTICS, self.messages.encode(self.messages.diagnostics(estimate))


def image_of(message: Any) -> Any:
    """The pixels of a sensor_msgs/Image, grey or blue first. Raises FrameError for an encoding that is not known."""
    channels = _CHANNELS.get(message.encoding)
    if channels is None:
        raise sfm.FrameError(
            f"images are {message.encoding}; supported are {', '.join(_CHANNELS)}: convert them first"
        )
    deep = "16" in message.encoding
    kind = np.dtype(np.uint16 if deep else np.uint8).newbyteorder(">" if message.is_bigendian else "<")
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    pixels = np.ascontiguousarray(rows[:, : message.width * channels * kind.itemsize]).view(kind)
    if channels == 1:
        return pixels.astype(kind.newbyteorder("="))
    pixels = pixels.reshape(message.height, message.width, channels)
    return pixels[..., [2, 1, 0, 3][:channels]] if message.encoding.startswith("rgb") else pixels


def rig_of(left: Any, right: Any, rectified: bool = False) -> sfm.StereoRig:
    """The rig of two sensor_msgs/CameraInfo. Raises ConfigError where the cameras are not calibrated."""
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
