"""The node: subscribes to a stereo camera, and publishes the messages of `StereoOdometry`."""

import threading
from functools import partial
from importlib import import_module
from typing import Any

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

import stream_sfm as sfm

from .odometry import StereoOdometry

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_SIDES = ("left", "right")
_WAIT_S = 0.2  # for images, before it is looked whether the node is to end


class OdometryNode(Node):
    """Parameters: `settings`, `config`, `calibration`, `rectified` as in `StereoOdometry`; `image_transport`.

    Callbacks only put images into a queue; a separate thread estimates. Late images are dropped and counted.
    """

    def __init__(self) -> None:
        super().__init__("stream_sfm")
        self.odometry = StereoOdometry(
            self.declare_parameter("settings", [""]).value,
            self.declare_parameter("config", "").value,
            self.declare_parameter("calibration", "").value,
            self.declare_parameter("rectified", False).value,
        )
        compressed = self.declare_parameter("image_transport", "raw").value == "compressed"
        kind, ending = (CompressedImage, "image_raw/compressed") if compressed else (Image, "image_raw")
        for side, name in enumerate(_SIDES):
            self.create_subscription(kind, f"{name}/{ending}", partial(self.put, side), qos_profile_sensor_data)
            self.create_subscription(
                CameraInfo, f"{name}/camera_info", partial(self.calibrate, side), qos_profile_sensor_data
            )
        self.publishers_by_topic = {
            topic: self.create_publisher(message, topic, _LATCHED if topic == "/tf_static" else 10)
            for topic, name in self.odometry.topics.items()
            if (message := self._type(name)) is not None
        }
        self.create_subscription(PoseWithCovarianceStamped, "~/set_pose", self.set_pose, 1)
        if (trigger := self._type("std_srvs/srv/Trigger")) is not None:
            self.create_service(trigger, "~/reset", self.reset)
        if (service := self._type("robot_localization/srv/SetPose", told=False)) is not None:
            self.create_service(service, "~/set_pose", self.set_pose)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._estimate, name="odometry")
        self._thread.start()

    def calibrate(self, side: int, info: CameraInfo) -> None:
        """Take the calibration of one camera."""
        try:
            self.odometry.calibrate(side, info)
        except sfm.ConfigError as error:
            self._warn(error)

    def put(self, side: int, image: Any) -> None:
        """Queue an image of one camera."""
        try:
            self.odometry.put(side, image)
        except sfm.FrameError as error:
            self._warn(error)

    def reset(self, _request: Any, response: Any) -> Any:
        """Start over with the next pair, at the origin."""
        self.odometry.reset()
        response.success, response.message = True, "the next pair begins a new map"
        return response

    def set_pose(self, given: Any, response: Any = None) -> Any:
        """Start over with the next pair, at a pose of robot or camera in the world frame; topic and service."""
        stamped = given if response is None else given.pose
        self.odometry.reset(stamped.pose.pose)
        return response

    def _estimate(self) -> None:
        """Estimate pair after pair, and publish the results; unusable images are reported."""
        while not self._ended.is_set():
            if self.odometry.engine is None:
                self._ended.wait(_WAIT_S)
                continue
            try:
                for topic, message in self.odometry.take(_WAIT_S):
                    if topic in self.publishers_by_topic and not self._ended.is_set():
                        self.publishers_by_topic[topic].publish(message)
            except sfm.StreamSfmError as error:
                self._warn(error)

    def _type(self, name: str, told: bool = True) -> Any:
        """A type of messages or services such as `nav_msgs/msg/Odometry`; None if its package is not there."""
        package, module, kind = name.split("/")
        try:
            return getattr(import_module(f"{package}.{module}"), kind)
        except ImportError:
            if told:
                self.get_logger().warning(f"{package} is not installed: no {kind}")
            return None

    def _warn(self, error: sfm.StreamSfmError) -> None:
        self.get_logger().warning(str(error), throttle_duration_sec=5.0)

    def destroy_node(self) -> None:
        """End the publishing thread first."""
        self._ended.set()
        self._thread.join()
        super().destroy_node()


def main() -> None:
    """Spin until the node is shut down."""
    rclpy.init()
    node = OdometryNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
