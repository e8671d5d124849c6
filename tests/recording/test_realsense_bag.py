"""Recordings of librealsense name no frames: each stream is one, and a topic has its pose to a common reference."""

from pathlib import Path

import numpy as np

import stream_sfm as sfm
from stream_sfm.geometry import se3
from tests.helpers.bags import messages_of, write_bag1
from tests.helpers.stereo_logs import PERIOD_NS, START_NS, Calib, LogWriter, scene, write_image, write_info

RIGHT_FROM_LEFT = se3.exp([-0.05, 1e-4, 2e-4, 1e-3, -2e-3, 5e-4])
CAM_FROM_IMU = se3.exp([0.01, 0.02, 0.03, 0, 0, 0])
STREAM = "/device_0/sensor_0/Infrared_{}"


def write(path: Path) -> Path:
    """A bag as the viewer writes it: poses carry points of the reference into the stream, on topics of their own."""
    log = LogWriter(path.with_suffix(".mcap"))
    streams = {STREAM.format(1): np.eye(4), STREAM.format(2): RIGHT_FROM_LEFT}
    streams["/device_0/sensor_2/Gyro_0"] = se3.inverse(CAM_FROM_IMU)
    for name, pose in streams.items():
        t, q = pose[:3, 3].tolist(), se3.quat_xyzw_from_matrix(pose[:3, :3]).tolist()
        moved = {"translation": dict(zip("xyz", t, strict=True)), "rotation": dict(zip("xyzw", q, strict=True))}
        log.ros("ros1", f"{name}/tf/0", "geometry_msgs/msg/Transform", moved, START_NS)
    zeros = np.zeros((3, 4))
    for n in (1, 2):
        info = Calib(P=zeros, model="Brown Conrady", D=(0.1, -0.05, 0.0, 0.0, 0.0))
        write_info(log, "ros1", f"{STREAM.format(n)}/info/camera_info", START_NS, info, "")
    for k in range(3):
        for n in (1, 2):
            topic = f"{STREAM.format(n)}/image/data"
            write_image(log, "ros1", topic, START_NS + k * PERIOD_NS, scene(k, n - 1), "mono8", "0")
    log.close()
    return write_bag1(path, messages_of(path.with_suffix(".mcap")))


def test_the_baseline_and_the_lenses_of_a_bag_of_the_viewer(tmp_path: Path) -> None:
    log = sfm.open_log(write(tmp_path / "20261128.bag"))
    np.testing.assert_allclose(log.stereo_rig.right_from_left, RIGHT_FROM_LEFT, atol=1e-9)
    assert log.rig.left.distortion_model == "plumb_bob" and log.rig.left.D[:2] == (0.1, -0.05)
    assert len(list(log.frames())) == 3 and log.stats.complete
