"""The ROS 2 node of the examples, but for rclpy: messages in, messages out, in the types of ROS 2."""

import ast
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

import stream_sfm as sfm
from tests.helpers.places import ROOT
from tests.helpers.wall import Wall, camera_path, rig

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
    from stream_sfm_ros.odometry import DIAGNOSTICS, StereoOdometry

    node = StereoOdometry(["ros.base_frame=base_link", "ros.camera_z_m=0.4", ""])
    engine, odometry = sfm.Engine(rig(), node.config), None
    for n, frame in enumerate(Wall(5).frames(rig(), camera_path(FRAMES))):
        messages = [image(picture, "mono8", frame.stamp_ns) for picture in frame.images]
        said = {
            topic: STORE.deserialize_cdr(data, node.topics[topic])
            for topic, data in node.frame(*messages, *infos(rig()))
        }
        estimate = engine.step(frame)
        odometry = sfm.Odometry.after(odometry, estimate)
        assert ("/tf_static" in said) == (n == 0)
        assert {"/stream_sfm/odometry", "/tf", "/stream_sfm/points", DIAGNOSTICS} <= set(said)
        moving = said["/stream_sfm/odometry"]
        assert (moving.header.frame_id, moving.child_frame_id) == ("odom", "base_link")
        assert moving.header.stamp.sec * 10**9 + moving.header.stamp.nanosec == frame.stamp_ns
        assert len(said["/stream_sfm/points"].data) // said["/stream_sfm/points"].point_step == len(
            estimate.track_ids
        )
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


def test_images_of_every_encoding_are_the_same_picture() -> None:
    from stream_sfm_ros.odometry import image_of

    rng = np.random.default_rng(1)
    colour = rng.integers(0, 256, (6, 8, 4), np.uint8)
    grey, deep = colour[..., 0], rng.integers(0, 2**16, (6, 8)).astype(np.uint16)
    for pixels, encoding, expected in (
        (grey, "mono8", grey),
        (deep, "mono16", deep),
        (colour[..., :3], "bgr8", colour[..., :3]),
        (colour[..., 2::-1], "rgb8", colour[..., :3]),
        (colour, "bgra8", colour),
        (colour[..., [2, 1, 0, 3]], "rgba8", colour),
    ):
        found = image_of(image(pixels, encoding, padding=4))
        assert np.array_equal(found, expected) and found.dtype == expected.dtype, encoding
    with pytest.raises(sfm.FrameError, match="images are yuv422; supported are mono8"):
        image_of(image(grey, "yuv422"))


def test_the_rig_is_that_of_the_camera_infos() -> None:
    from stream_sfm_ros.odometry import rig_of

    for rectified in (False, True):
        found = rig_of(*infos(rig()), rectified)
        assert np.allclose(found.right_from_left, rig().right_from_left) and np.allclose(found.left.K, rig().left.K)
    empty = infos(rig())
    empty[0].k[:] = 0
    with pytest.raises(sfm.ConfigError, match="hold no calibration"):
        rig_of(*empty)


def test_what_knows_of_rclpy_is_short_and_declared() -> None:
    text = (PACKAGE / "stream_sfm_ros/node.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) < 100
    used = {
        n.module.split(".")[0] for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom) and not n.level
    }
    used |= {a.name.split(".")[0] for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Import) for a in n.names}
    declared = {element.text for element in ET.parse(PACKAGE / "package.xml").getroot().iter("exec_depend")}
    assert used - {"stream_sfm"} <= declared
    from stream_sfm_ros.odometry import StereoOdometry

    assert {kind.split("/")[0] for kind in StereoOdometry().topics.values()} <= declared
    assert "has not been run under ROS 2" in (PACKAGE / "README.md").read_text(encoding="utf-8")
