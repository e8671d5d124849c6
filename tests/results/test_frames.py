"""Frames and axes of ROS: the robot is where the settings put it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from stream_sfm.config import Config, RosConfig
from stream_sfm.errors import ConfigError
from stream_sfm.geometry import se3
from stream_sfm.motion import Odometry
from stream_sfm.results.estimate_messages import PathSoFar
from stream_sfm.results.estimates_reader import read_clouds, read_estimates
from stream_sfm.results.frames import RosFrames, fixed_axis_covariance
from stream_sfm.results.ros_messages import POINT_DTYPE
from stream_sfm.types import FrameEstimate, RelativeMotions
from tests.results.test_estimates import estimate, matrix, write

ON_ROBOT = {"camera_x_m": 0.3, "camera_z_m": 0.5, "camera_pitch_deg": 90}
ROBOT = RosConfig(world_frame="earth", odom_frame="start", base_frame="base_link", camera_frame="cam0", **ON_ROBOT)


def messages(path: Path, topic: str) -> list:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [said for _, _, _, said in reader.iter_decoded_messages([topic])]


def transform(stamped) -> np.ndarray:
    return matrix(stamped.transform.translation, stamped.transform.rotation)


def moving(i: int) -> FrameEstimate:
    """The estimates of the tests of files, with their motions; from the fourth frame on the world is corrected."""
    now, correction = estimate(i), se3.exp([0.3, 0, 0, 0, 0, 0.2]) if i >= 3 else np.eye(4)
    motion = se3.inverse(estimate(max(i - 1, 0)).world_from_cam) @ now.world_from_cam
    relative = RelativeMotions(np.array([i - 1]), motion[None], now.cov_pose[None]) if i else None
    return replace(now, world_from_cam=correction @ now.world_from_cam, relative=relative)


@pytest.fixture(scope="module")
def robot(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("robot") / "estimates.mcap"
    return write(path, map(moving, range(5)), Config(ros=ROBOT))


def test_where_a_map_of_places_corrects_the_world_the_transforms_follow(tmp_path: Path) -> None:
    """Map from odom, the pose, and the points; odom and our own message stay as they are."""
    here = se3.exp([0.5, -0.2, 0.1, 0.1, 0.3, -0.2])
    for name, where in (("plain", None), ("corrected", lambda: here)):
        write(tmp_path / name, map(moving, range(3)), Config(), where)

    def both(topic: str) -> list:
        return [messages(tmp_path / name, topic)[-1] for name in ("plain", "corrected")]

    plain, corrected = both("/tf")
    assert np.allclose(transform(corrected.transforms[0]), here @ transform(plain.transforms[0]), atol=1e-12)
    assert np.allclose(transform(corrected.transforms[1]), transform(plain.transforms[1]), atol=1e-15)
    poses = [matrix(said.pose.pose.position, said.pose.pose.orientation) for said in both("/stream_sfm/pose")]
    assert np.allclose(poses[1], here @ poses[0], atol=1e-12)
    plain, corrected = (np.frombuffer(said.data, POINT_DTYPE) for said in both("/stream_sfm/map"))
    xyz = [np.stack([points[axis] for axis in "xyz"], axis=1) for points in (plain, corrected)]
    assert np.allclose(xyz[1], se3.transform(here, xyz[0]), atol=1e-5)
    assert np.allclose(plain["sigma_m"], corrected["sigma_m"], rtol=1e-4)
    plain, corrected = both("/stream_sfm/estimate")
    assert list(plain.world_from_cam) == list(corrected.world_from_cam)


def test_the_camera_stands_on_the_robot_as_the_settings_say(robot: Path) -> None:
    (sent,) = messages(robot, "/tf_static")
    (mounted,) = sent.transforms
    assert (mounted.header.frame_id, mounted.child_frame_id) == ("base_link", "cam0")
    base_from_cam = transform(mounted)
    # It looks straight down: its z axis is the robot's −z, its x axis the robot's −y (right), its y axis −x.
    assert np.allclose(base_from_cam[:3, :3], [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], atol=1e-12)
    assert np.allclose(base_from_cam[:3, 3], [0.3, 0, 0.5])


def test_the_chain_of_transforms_is_the_motion_of_the_camera(robot: Path) -> None:
    (mounted,) = messages(robot, "/tf_static")[0].transforms
    base_from_cam = transform(mounted)
    for i, sent in enumerate(messages(robot, "/tf")):
        corrected, moved = sent.transforms
        assert (corrected.header.frame_id, corrected.child_frame_id) == ("earth", "start")
        assert (moved.header.frame_id, moved.child_frame_id) == ("start", "base_link")
        odom_from_cam = transform(moved) @ base_from_cam
        assert np.allclose(odom_from_cam, base_from_cam @ estimate(i).world_from_cam, atol=1e-12)  # never corrected
        world_from_cam = transform(corrected) @ odom_from_cam
        assert np.allclose(world_from_cam, base_from_cam @ moving(i).world_from_cam, atol=1e-12)
    assert {cloud.frame_id for cloud in read_clouds(robot)} == {"cam0"}
    assert {cloud.frame_id for cloud in read_clouds(robot, "/stream_sfm/map")} == {"earth"}
    own = [record.world_from_cam for record in read_estimates(robot)]  # is not touched
    assert np.array_equal(own, [moving(i).world_from_cam for i in range(5)])


def test_the_velocity_is_that_by_which_the_robot_moves(robot: Path) -> None:
    """Constant over the interval, in axes of the robot, as ROS has it, and it carries the robot to where it is next."""
    base_from_cam, before = RosFrames(ROBOT).base_from_cam, np.eye(4)
    for i, odom in enumerate(messages(robot, "/stream_sfm/odometry")):
        assert (odom.header.frame_id, odom.child_frame_id) == ("start", "base_link")
        now = matrix(odom.pose.pose.position, odom.pose.pose.orientation)
        twist, cov = odom.twist.twist, np.reshape(odom.twist.covariance, (6, 6))
        if i == 0:
            assert cov[0, 0] == -1 and not np.any([twist.linear.x, twist.angular.z])  # ROS: not estimated
        else:
            v, w = twist.linear, twist.angular
            assert np.allclose(before @ se3.exp(0.1 * np.array([v.x, v.y, v.z, w.x, w.y, w.z])), now, atol=1e-12)
            turned = se3.adjoint(base_from_cam)
            own = Odometry.after(Odometry.after(None, moving(i - 1)), moving(i)).cov_twist
            assert own is not None and np.allclose(cov, turned @ own @ turned.T, atol=1e-15)
        before = now


@pytest.mark.parametrize("fixed", [False, True])
def test_covariances_of_the_robot_are_those_of_its_errors(fixed: bool) -> None:
    """Monte Carlo: errors of the camera's pose, carried over to the base; of ROS, along and about the fixed axes."""
    frames, rng, n = RosFrames(ROBOT), np.random.default_rng(1), 40_000
    pose, half = estimate(4).world_from_cam, rng.normal(size=(6, 6)) * 1e-3
    true, base = frames.pose(pose @ se3.exp(rng.normal(size=(n, 6)) @ half.T)), frames.pose(pose)
    errors, expected = se3.log(se3.inverse(base) @ true), frames.cov_pose(half @ half.T)
    if fixed:
        errors = np.c_[true[:, :3, 3] - base[:3, 3], se3.log_so3(true[:, :3, :3] @ base[:3, :3].T)]
        expected = fixed_axis_covariance(base[:3, :3], expected)
    scale = np.sqrt(np.diag(expected))
    difference = abs((errors.T @ errors / n - expected) / np.outer(scale, scale)).max()
    assert difference < 5 * np.sqrt(2 / n)  # standard errors of a variance


def test_axes_are_those_of_ros() -> None:
    """With z up forward is x; yaw turns to the left, pitch down, roll to the right, in this order from the outside."""
    frames = RosFrames(RosConfig(z_up=True))
    forward, up = se3.exp([0, 0, 2.0, 0, 0, 0]), se3.exp([0, -3.0, 0, 0, 0, 0])
    assert np.allclose([frames.pose(forward)[:3, 3], frames.pose(up)[:3, 3]], [[2, 0, 0], [0, 0, 3]])
    assert (frames.world, frames.moving, frames.base_from_cam) == ("map", "left_camera", None)
    looks = RosFrames(RosConfig(base_frame="b", camera_yaw_deg=90, camera_pitch_deg=30)).base_from_cam[:3, 2]
    assert np.allclose(looks, [0, np.cos(np.radians(30)), -np.sin(np.radians(30))])
    rolled = RosFrames(RosConfig(base_frame="b", camera_roll_deg=90)).base_from_cam
    assert np.allclose(rolled[:3, 1], [0, 1, 0], atol=1e-12)  # its lower side points to the left


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"world_frame": ""}, r"ros\.world_frame is ''; give a name .* as in map"),
        ({"world_frame": "odom"}, r"need different names, not odom, odom, left_camera: .* which ROS calls map"),
        ({"base_frame": "my robot"}, r"ros\.base_frame is 'my robot'; .* as in base_link"),
        ({"camera_frame": "map"}, r"need different names, not map, odom, map"),
        ({"camera_x_m": float("nan")}, r"camera_x_m=nan\): give a number"),
    ],
)
def test_frames_that_ros_cannot_use_are_refused(settings: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        RosConfig(**settings)


def test_a_long_path_is_thinned_and_repeated_rarely() -> None:
    path, frames, written = PathSoFar(), 20_000, 0
    for i in range(frames):
        if path.add(i):
            written += len(path.poses())
            assert path.poses()[0] == 0 and path.poses()[-1] == i
    poses = path.poses()
    assert len(poses) <= 4097 and poses[-1] == frames - 1  # as docs/formats.md says
    assert set(np.diff(poses[:-1])) == {8}  # evenly: 20 000 / 4096, to the next power of two
    assert written < 25 * frames  # a sum over lengths that grow by a twentieth is 21 times the last one
