"""The node: subscribes to a stereo camera, and publishes what `StereoOdometry` makes of it."""

import message_filters
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rosidl_runtime_py.utilities import get_message
from sensor_msgs.msg import CameraInfo, Image

import stream_sfm as sfm

from .odometry import StereoOdometry

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_QUEUE = 10  # messages of a topic that wait for their partners


class OdometryNode(Node):
    """Parameters: `settings`, `config`, `calibration`, `rectified` as in `StereoOdometry`; `slop_s` between stamps."""

    def __init__(self) -> None:
        super().__init__("stream_sfm")
        self.odometry = StereoOdometry(
            self.declare_parameter("settings", [""]).value,
            self.declare_parameter("config", "").value,
            self.declare_parameter("calibration", "").value,
            self.declare_parameter("rectified", False).value,
        )
        self.publishers_by_topic = {
            topic: self.create_publisher(get_message(kind), topic, _LATCHED if topic == "/tf_static" else 10)
            for topic, kind in self.odometry.topics.items()
        }
        self.inputs = [
            message_filters.Subscriber(self, kind, f"{side}/{name}", qos_profile=qos_profile_sensor_data)
            for kind, name in ((Image, "image_raw"), (CameraInfo, "camera_info"))
            for side in ("left", "right")
        ]
        slop_s = self.declare_parameter("slop_s", 0.005).value
        self.pairs = message_filters.ApproximateTimeSynchronizer(self.inputs, _QUEUE, slop_s)
        self.pairs.registerCallback(self.take)

    def take(self, left: Image, right: Image, left_info: CameraInfo, right_info: CameraInfo) -> None:
        """Estimate one pair, and publish what is known then; a pair that cannot be used is told and left out."""
        try:
            for topic, message in self.odometry.frame(left, right, left_info, right_info):
                self.publishers_by_topic[topic].publish(message)
        except sfm.StreamSfmError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=5.0)


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
