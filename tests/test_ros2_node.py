"""The ROS 2 node of the examples: messages in and out, in the types of ROS 2, and over ROS if rclpy is installed."""

import ast
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

import stream_sfm as sfm
from tests.helpers.places import ROOT
from tests.helpers.wall import PERIOD_NS, Wall, camera_path, rig

PACKAGE = ROOT / "examples/ros2"
STORE = get_typestore(Stores.ROS2_HUMBLE)
FRAMES = 4


@pytest.fixture(scope="module", autouse=True)
def _package() -> Iterator[None]:
    sys.path.insert(0, str(PACKAGE))
    yield
    sys.path.remove(str(PACKAGE))


def header(stamp_ns: int) -> Any:
    time = STORE.types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    return STORE.types["std_msgs/msg/Header"](time, "left")


def image(pixels: np.ndarray, encoding: str, stamp_ns: int = 0, padding: int = 0) -> Any:
    """A sensor_msgs/Image as it arrives: through CDR, with rows that may be padded."""
    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, -1)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    kind = "sensor_msgs/msg/Image"
    fields = (header(stamp_ns), height, width, encoding, 0, rows.shape[1], rows.ravel())
    message = STORE.types[kind](*fields)
    return STORE.deserialize_cdr(STORE.serialize_cdr(message, kind), kind)


def infos(of: sfm.StereoRig) -> list[Any]:
    """The camera infos of a parallel pair, as calibrators write them."""
    region = STORE.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    found = []
    for camera, x in ((of.left, 0.0), (of.right, of.right_from_left[0, 3])):
        k, p = camera.K, np.c_[camera.K, [x * camera.K[0, 0], 0, 0]]
        numbers = np.zeros(5), k.ravel(), np.eye(3).ravel(), p.ravel()
        found.append(
            STORE.types["sensor_msgs/msg/CameraInfo"](
                header(0), camera.height, camera.width, "plumb_bob", *numbers, 0, 0, region
            )
        )
    return found


def test_the_messages_are_those_of_the_engine() -> None:
    from stream_sfm_ros.odometry import DIAGNOSTICS, StereoOdometry, rig_of

    node = StereoOdometry(["ros.base_frame=base_link", "ros.camera_z_m=0.4", ""])
    assert list(node.take(0.0)) == []  # no camera infos, no images
    node.begin(rig_of(*infos(rig())))
    engine, odometry = sfm.Engine(rig(), node.config), None
    for n, frame in enumerate(Wall(5).frames(rig(), camera_path(FRAMES))):
        for side, picture in enumerate(frame.images):
            node.put(side, image(picture, "mono8", frame.stamp_ns))
        said = {topic: STORE.deserialize_cdr(data, node.topics[topic]) for topic, data in node.take(0.0)}
        estimate = engine.step(frame)
        odometry = sfm.Odometry.after(odometry, estimate)
        assert ("/tf_static" in said) == (n == 0)
        assert {"/stream_sfm/odometry", "/tf", "/stream_sfm/points", DIAGNOSTICS} <= set(said)
        moving = said["/stream_sfm/odometry"]
        assert (moving.header.frame_id, moving.child_frame_id) == ("odom", "base_link")
        assert moving.header.stamp.sec * 10**9 + moving.header.stamp.nanosec == frame.stamp_ns
        assert len(said["/stream_sfm/points"].data) // said["/stream_sfm/points"].point_step == len(estimate.track_ids)
        if odometry.twist is None:
            assert moving.twist.covariance[0] == -1
        else:  # forward is x of the robot and z of the camera
            turned = np.cross(
                [moving.twist.twist.angular.x, moving.twist.twist.angular.y, moving.twist.twist.angular.z],
                [0, 0, 0.4],
            )
            assert moving.twist.twist.linear.x + turned[0] == pytest.approx(odometry.twist[2], abs=1e-9)
        (status,) = said[DIAGNOSTICS].status
        assert status.message.startswith(str(estimate.status)) and status.level in (0, b"\x00")


def compressed(pixels: np.ndarray, stamp_ns: int, ending: str = ".png") -> Any:
    """A sensor_msgs/CompressedImage as it arrives."""
    kind = "sensor_msgs/msg/CompressedImage"
    data = np.frombuffer(cv2.imencode(ending, pixels)[1].tobytes(), np.uint8)
    message = STORE.types[kind](header(stamp_ns), ending[1:], data)
    return STORE.deserialize_cdr(STORE.serialize_cdr(message, kind), kind)


def test_images_of_every_encoding_are_the_same_picture() -> None:
    rng, images = np.random.default_rng(1), sfm.RosImages(rig())
    grey = cv2.GaussianBlur(rng.integers(0, 256, (240, 320), np.uint8), (0, 0), 3)
    bgr = np.stack([grey, grey, grey], axis=2)
    yuyv = np.stack([grey, np.full_like(grey, 128)], axis=2)
    kinds: list[Any] = [
        lambda stamp: image(grey, "mono8", stamp, padding=4),
        lambda stamp: image(grey.astype(np.uint16) * 257, "mono16", stamp), lambda stamp: image(bgr, "bgr8", stamp),
        lambda stamp: image(bgr, "rgb8", stamp), lambda stamp: image(np.dstack([bgr, grey]), "bgra8", stamp),
        lambda stamp: image(yuyv, "yuv422_yuy2", stamp), lambda stamp: image(grey, "bayer_rggb8", stamp),
        lambda stamp: compressed(grey, stamp), lambda stamp: compressed(bgr, stamp, ".webp"),
    ]  # fmt: skip
    for n, kind in enumerate(kinds):
        for side in (0, 1):
            images.put(side, kind(n * PERIOD_NS))
        frame = images.take(0.0)
        assert frame is not None and frame.stamp_ns == n * PERIOD_NS
        assert np.abs(frame.left.astype(int) - grey).mean() < 3, n  # of a mosaic, and of WebP
    with pytest.raises(sfm.FrameError, match=r"image encoding 'dots' is not supported; supported are .*mono8"):
        images.put(0, image(grey, "dots", 99 * PERIOD_NS))
    assert images.take(0.0) is None


def test_images_are_paired_as_those_of_a_log_and_late_ones_are_dropped_in_the_open() -> None:
    images, grey = sfm.RosImages(rig()), np.zeros((240, 320), np.uint8)
    for n in range(10):  # the right ones are 2 ms late, and one is missing
        images.put(0, image(grey, "mono8", n * PERIOD_NS))
        if n != 4:
            images.put(1, image(grey, "mono8", n * PERIOD_NS + 2_000_000))
    taken = []
    while (frame := images.take(0.0)) is not None:
        taken.append(frame.stamp_ns // PERIOD_NS)
    assert taken == [7, 8] and images.dropped == 6 and images.unpaired == 1  # the next frame decides about the last one
    images.put(0, image(grey, "mono8", 3 * PERIOD_NS))
    images.put(1, image(grey, "mono8", 3 * PERIOD_NS))
    assert images.take(0.0) is None  # its stamp does not ascend
    images.clear()
    for side in (0, 1):
        images.put(side, image(grey[:100], "mono8", 3 * PERIOD_NS))
    with pytest.raises(sfm.FrameError, match="is of 320×100 pixels, its calibration is for 320×240"):
        images.take(0.0)
    broken = compressed(cv2.randu(grey.copy(), 0, 255), 4 * PERIOD_NS)
    broken.data = broken.data[:5000]
    for side in (0, 1):
        images.put(side, broken)
    with pytest.raises(sfm.FrameError, match="left"):
        images.take(0.0)


def test_a_reset_starts_at_the_given_pose() -> None:
    from stream_sfm_ros.odometry import StereoOdometry, rig_of

    node = StereoOdometry(["ros.base_frame=base_link", "ros.camera_x_m=0.2", "ros.camera_pitch_deg=20"])
    node.begin(rig_of(*infos(rig())))

    def said(frame: sfm.StereoFrame, stamp_ns: int) -> dict[str, Any]:
        for side, picture in enumerate(frame.images):
            node.put(side, image(picture, "mono8", stamp_ns))
        return {topic: STORE.deserialize_cdr(data, node.topics[topic]) for topic, data in node.take(0.0)}

    frames = Wall(5).frames(rig(), camera_path(FRAMES))
    for frame in frames:
        assert said(frame, frame.stamp_ns + 10**12)
    q = STORE.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(0.4), np.cos(0.4))
    node.reset(STORE.types["geometry_msgs/msg/Pose"](STORE.types["geometry_msgs/msg/Point"](3.0, -2.0, 0.5), q))
    for frame in frames[:2]:  # their clock was set back meanwhile
        found = said(frame, frame.stamp_ns)
        pose = found["/stream_sfm/pose"].pose.pose
        if frame is frames[0]:
            assert "/tf_static" in found and found["/stream_sfm/odometry"].pose.pose.position == pose.position
            assert (pose.position.x, pose.position.y, pose.position.z) == pytest.approx((3, -2, 0.5), abs=1e-9)
            assert (pose.orientation.z, pose.orientation.w) == pytest.approx((np.sin(0.4), np.cos(0.4)), abs=1e-9)
    node.reset()
    assert said(frames[2], frames[2].stamp_ns)["/stream_sfm/pose"].pose.pose.position.x == pytest.approx(0, abs=1e-9)


def test_the_rig_is_that_of_the_camera_infos() -> None:
    from stream_sfm_ros.odometry import rig_of

    for rectified in (False, True):
        found = rig_of(*infos(rig()), rectified)
        assert np.allclose(found.right_from_left, rig().right_from_left) and np.allclose(found.left.K, rig().left.K)
    empty = infos(rig())
    empty[0].k[:] = 0
    with pytest.raises(sfm.ConfigError, match="hold no calibration"):
        rig_of(*empty)


def test_camera_infos_that_change_begin_a_new_map_at_the_last_pose() -> None:
    from stream_sfm_ros.odometry import StereoOdometry

    node, before, later = StereoOdometry(), infos(rig()), infos(rig())
    for info in later:
        info.k[0] = info.p[0] = 286.0
    frames = Wall(5).frames(rig(), camera_path(FRAMES))

    def shown(frame: sfm.StereoFrame, sent: list[Any]) -> Any:
        for side, info in enumerate(sent):
            node.calibrate(side, info)
        for side, picture in enumerate(frame.images):
            node.put(side, image(picture, "mono8", frame.stamp_ns))
        said = dict(node.take(0.0))
        return STORE.deserialize_cdr(said["/stream_sfm/pose"], node.topics["/stream_sfm/pose"]).pose.pose.position

    for frame in frames[:2]:
        last = shown(frame, before)
        engine = node.engine
    assert engine is not None and np.hypot(last.x, last.z) > 1e-3
    assert list(node.take(0.0)) == [] and node.engine is engine  # equal infos change nothing
    for side, info in enumerate(later):
        node.calibrate(side, info)
    assert list(node.take(0.0)) == []  # the images of the other calibration are dropped
    p = shown(frames[2], later)
    assert node.engine is not engine and node.engine is not None
    assert node.engine.rig.left.K[0, 0] == 286.0 != rig().left.K[0, 0]
    assert (p.x, p.y, p.z) == pytest.approx((last.x, last.y, last.z), abs=1e-12)
    broken = infos(rig())
    broken[0].k[:] = 0
    with pytest.raises(sfm.ConfigError, match="hold no calibration"):
        node.calibrate(0, broken[0])
    assert list(node.take(0.0)) == [] and node.engine.rig.left.K[0, 0] > 0


def test_what_knows_of_rclpy_is_short_and_declared() -> None:
    text = (PACKAGE / "stream_sfm_ros/node.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) < 150
    used = {n.module.split(".")[0] for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom) and not n.level}
    used |= {a.name.split(".")[0] for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Import) for a in n.names}
    declared = {element.text for element in ET.parse(PACKAGE / "package.xml").getroot().iter("exec_depend")}
    assert used - {"stream_sfm"} - sys.stdlib_module_names <= declared
    from stream_sfm_ros.odometry import StereoOdometry

    assert {kind.split("/")[0] for kind in StereoOdometry().topics.values()} <= declared


@pytest.mark.slow
@pytest.mark.parametrize("transport", ["raw", "compressed"])
def test_the_node_says_over_ros_what_the_engine_says(transport: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over loopback, in a domain of its own: pair by pair, so that none is dropped."""
    rclpy = pytest.importorskip("rclpy", reason="needs ROS 2: see examples/ros2/README.md for wheels")
    pytest.importorskip("std_srvs", reason="needs std_srvs of ROS 2: see examples/ros2/README.md")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(int(np.random.default_rng().integers(1, 100))))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init(args=["--ros-args", "-p", f"image_transport:={transport}"])
    try:
        over_ros(rclpy, transport)
    finally:
        rclpy.try_shutdown()


def over_ros(rclpy: Any, transport: str) -> None:
    """Run the node beside a camera that waits for the odometry of each pair, and reset it in the end."""
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import CameraInfo, CompressedImage, Image
    from std_srvs.srv import Trigger
    from stream_sfm_ros.node import OdometryNode

    kind, ending = (CompressedImage, "/compressed") if transport == "compressed" else (Image, "")
    node, camera, executor = OdometryNode(), rclpy.create_node("camera"), SingleThreadedExecutor()
    executor.add_node(node)
    executor.add_node(camera)
    poses: list[Any] = []
    camera.create_subscription(PoseWithCovarianceStamped, "/stream_sfm/pose", poses.append, 10)
    moving: list[Any] = []
    camera.create_subscription(Odometry, "/stream_sfm/odometry", moving.append, 10)
    images = [camera.create_publisher(kind, f"{side}/image_raw{ending}", 10) for side in ("left", "right")]
    calibrations = [camera.create_publisher(CameraInfo, f"{side}/camera_info", 10) for side in ("left", "right")]
    reset = camera.create_client(Trigger, "/stream_sfm/reset")

    def until(done: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + 60
        while not done():
            assert time.monotonic() < deadline_s, "no answer in a minute"
            executor.spin_once(timeout_sec=0.05)

    def cdr(message: Any) -> bytes:
        return bytes(STORE.serialize_cdr(message, message.__msgtype__))

    def show(frame: sfm.StereoFrame) -> Any:
        before = len(poses), len(moving)
        for publisher, picture in zip(images, frame.images, strict=True):
            made = compressed(picture, frame.stamp_ns) if ending else image(picture, "mono8", frame.stamp_ns)
            publisher.publish(deserialize_message(cdr(made), kind))
        until(lambda: len(poses) > before[0] and len(moving) > before[1])
        return poses[-1].pose.pose.position

    try:
        until(lambda: all(p.get_subscription_count() for p in (*images, *calibrations)) and reset.service_is_ready())
        for publisher, info in zip(calibrations, infos(rig()), strict=True):
            publisher.publish(deserialize_message(cdr(info), CameraInfo))
        until(lambda: node.odometry.engine is not None)
        engine = sfm.Engine(rig())
        for frame in Wall(5).frames(rig(), camera_path(FRAMES)):
            p, estimate = show(frame), engine.step(frame)
            assert (p.x, p.y, p.z) == pytest.approx(estimate.world_from_cam[:3, 3], abs=1e-12)
        assert node.odometry.images is not None and node.odometry.images.dropped == 0
        answer = reset.call_async(Trigger.Request())
        until(answer.done)
        assert answer.result().success
        p = show(Wall(5).frames(rig(), camera_path(1))[0])  # earlier than all others
        assert (p.x, p.y, p.z) == (0, 0, 0)
    finally:
        executor.shutdown()
        node.destroy_node()
        camera.destroy_node()
