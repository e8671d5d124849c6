"""What a run writes is what other tools read: round trips, conventions, crashes, second opinions."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoderFactory
from mcap_ros2.decoder import DecoderFactory as Ros2DecoderFactory

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.config import Config, config_to_toml
from stream_sfm.errors import InputError, OutputError
from stream_sfm.geometry import se3
from stream_sfm.results import ros as odometry
from stream_sfm.results.estimates_reader import read_clouds, read_estimates, read_trajectory
from stream_sfm.results.estimates_writer import EstimatesWriter
from stream_sfm.results.trajectory_files import KittiWriter, TumWriter, read_tum
from stream_sfm.types import FrameEstimate, Status

START_NS = 1_700_000_000_123_456_789


def rig() -> StereoRig:
    k = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
    return StereoRig(Camera(320, 240, k), Camera(320, 240, k), se3.exp([-0.2, 0, 0, 0, 0.01, 0]))


def estimate(i: int, points: int = 5) -> FrameEstimate:
    rng = np.random.default_rng(i)
    half = rng.normal(scale=0.01, size=(6, 6))
    cov = rng.normal(scale=0.1, size=(points, 3, 3))
    cov = cov @ cov.swapaxes(1, 2)
    pose = se3.exp(0.1 * i * np.array([0.2, 0.1, 1, 0.1, 0.2, 0.3]))
    in_cam = rng.uniform(1, 4, size=(points, 3))
    return FrameEstimate(
        frame_index=i,
        stamp_ns=START_NS + i * 100_000_000,
        status=Status.OK if i else Status.INITIALISING,
        reason="" if i else "first frame",
        world_from_cam=pose,
        cov_pose=half @ half.T,
        track_ids=np.arange(i, i + points, dtype=np.int64),
        points_in_cam=in_cam,
        cov_points=cov,
        points_in_world=se3.transform(pose, in_cam),
        cov_points_in_world=cov,
        window_frame_indices=np.array([i]),
        window_world_from_cam=pose[None],
        ended_ids=np.array([i - 1] if i else [], dtype=np.int64),
        ended_points_in_world=np.full((1 if i else 0, 3), float(i)),
        ended_cov_points_in_world=np.tile(np.eye(3), (1 if i else 0, 1, 1)),
        counts={"tracked": points, "new": 1, "used": points, "rejected": 0},
        nis=3.5,
        nis_dof=4,
        timings_ms={"frontend": 1.0, "estimator": 2.0},
    )


def write(path: Path, estimates) -> Path:
    writer = EstimatesWriter(path, rig(), Config())
    for e in estimates:
        writer.write(e)
    writer.close()
    return path


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("out") / "estimates.mcap", [estimate(i) for i in range(25)])


def test_estimates_come_back_to_the_last_bit(written: Path):
    records = list(read_estimates(written))
    trajectory = read_trajectory(written)
    assert len(records) == 25
    for i, record in enumerate(records):
        e = estimate(i)
        assert (record.stamp_ns, record.status, record.counts) == (e.stamp_ns, e.status, e.counts)
        assert (trajectory.world_from_cam[i] == e.world_from_cam).all()
        assert (trajectory.cov_pose[i] == e.cov_pose).all()


def test_points_come_back_with_their_covariances(written: Path):
    clouds = list(read_clouds(written))
    e = estimate(7)
    assert len(clouds) == 25 and clouds[7].frame_id == "left_camera"
    assert (clouds[7].track_ids == e.track_ids).all()
    assert np.allclose(clouds[7].points, e.points_in_cam, rtol=1e-6)
    assert np.allclose(clouds[7].cov_points, e.cov_points, rtol=1e-6)


def test_the_map_holds_each_point_once(written: Path):
    ids = np.concatenate([cloud.track_ids for cloud in read_clouds(written, "/stream_sfm/map")])
    assert sorted(ids.tolist()) == list(range(29))


def test_every_topic_decodes_with_the_public_libraries_and_says_the_same(written: Path):
    last = {}
    with open(written, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[ProtobufDecoderFactory(), Ros2DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages(
            ["/stream_sfm/pose", "/stream_sfm/odometry", "/tf", "/stream_sfm/points"]
        ):
            last[channel.topic] = (schema.name, message, decoded)
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        attachments = {a.name: a.data.decode() for a in reader.iter_attachments()}
    e = estimate(24)
    quat = se3.quat_xyzw_from_matrix(e.world_from_cam[:3, :3])
    name, message, pose = last["/stream_sfm/pose"]
    assert name == "foxglove.PoseInFrame" and pose.frame_id == "world"
    assert (message.log_time, message.publish_time, message.sequence) == (e.stamp_ns, e.stamp_ns, 24)
    assert pose.timestamp.ToNanoseconds() == e.stamp_ns
    position = pose.pose.position
    assert [position.x, position.y, position.z] == e.world_from_cam[:3, 3].tolist()
    name, _, odom = last["/stream_sfm/odometry"]
    assert name == "nav_msgs/msg/Odometry"
    assert (odom.header.frame_id, odom.child_frame_id) == ("world", "left_camera")
    assert odom.header.stamp.sec * 10**9 + odom.header.stamp.nanosec == e.stamp_ns
    o = odom.pose.pose.orientation
    assert np.allclose([o.x, o.y, o.z, o.w], quat, atol=1e-15)
    cov = odometry.body_covariance(e.world_from_cam[:3, :3], np.array(odom.pose.covariance).reshape(6, 6))
    assert np.allclose(cov, e.cov_pose, atol=1e-15)
    assert odom.twist.covariance[0] == -1
    name, _, tf = last["/tf"]
    assert (tf.parent_frame_id, tf.child_frame_id) == ("world", "left_camera")
    assert np.allclose([tf.rotation.x, tf.rotation.y, tf.rotation.z, tf.rotation.w], quat, atol=1e-15)
    assert metadata["configuration"]["config.toml"] == config_to_toml(Config())
    assert metadata["stream_sfm"]["method"] == "cross-frame"
    assert attachments["calibration.toml"] == rig().to_toml()


def test_the_schema_describes_every_field(written: Path):
    with open(written, "rb") as stream:
        schemas = {s.name: s for s in make_reader(stream).get_summary().schemas.values()}
        message = next(make_reader(stream).iter_messages(["/stream_sfm/estimate"]))[2]
    schema = json.loads(schemas["stream_sfm.Estimate"].data)
    assert schema["type"] == "object"
    fields = json.loads(message.data)
    assert set(fields) == set(schema["properties"])
    assert all("description" in p for p in schema["properties"].values())


def test_two_runs_differ_in_the_timing_topic_only(tmp_path: Path):
    estimates = [estimate(i) for i in range(6)]
    slower = [replace(e, timings_ms={"frontend": 9.0}) for e in estimates]
    a, b = write(tmp_path / "a.mcap", estimates), write(tmp_path / "b.mcap", slower)
    assert messages(a) == messages(b)
    assert write(tmp_path / "c.mcap", estimates).read_bytes() == a.read_bytes()


def messages(path: Path) -> list:
    with open(path, "rb") as stream:
        return [
            (channel.topic, m.log_time, m.publish_time, m.sequence, m.data)
            for _, channel, m in make_reader(stream).iter_messages()
            if channel.topic != "/stream_sfm/timing"
        ]


def test_numbers_that_are_not_finite_are_null_and_come_back_as_nan(tmp_path: Path):
    lost = replace(estimate(0), cov_pose=np.full((6, 6), np.inf), status=Status.LOST)
    path = write(tmp_path / "e.mcap", [lost])
    assert np.isnan(read_trajectory(path).cov_pose).all()


def test_a_killed_run_loses_at_most_the_last_half_second(tmp_path: Path):
    writer = EstimatesWriter(tmp_path / "e.mcap", rig(), Config())
    for i in range(23):
        writer.write(estimate(i))
    part = tmp_path / "e.mcap.part"
    assert not (tmp_path / "e.mcap").exists()
    assert len(list(read_estimates(part))) >= 23 - 6
    shutil.copy(part, tmp_path / "killed.mcap")
    writer.close()
    assert not part.exists()
    assert len(list(read_estimates(tmp_path / "e.mcap"))) == 23
    assert len(list(read_estimates(tmp_path / "killed.mcap"))) >= 23 - 6


def test_an_empty_run_leaves_a_readable_file(tmp_path: Path):
    assert list(read_estimates(write(tmp_path / "e.mcap", []))) == []


def test_a_folder_that_cannot_be_written_is_an_output_error(tmp_path: Path):
    with pytest.raises(OutputError, match=r"nowhere/e\.mcap"):
        EstimatesWriter(tmp_path / "nowhere" / "e.mcap", rig(), Config())


def test_a_full_disk_is_an_output_error_that_says_what_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    monkeypatch.setattr("stream_sfm.files._create", lambda _: open("/dev/full", "wb"))  # noqa: SIM115
    writer = TumWriter(tmp_path / "t.tum")
    with pytest.raises(OutputError, match=r"t\.tum.*No space left"):
        writer.write(estimate(0))
    with pytest.raises(OutputError):
        writer.close()


def test_ros_covariance_round_trip():
    rng = np.random.default_rng(3)
    half, r = rng.normal(size=(6, 6)), se3.exp_so3([0.5, -1.0, 2.0])
    cov = half @ half.T
    assert np.allclose(odometry.body_covariance(r, odometry.fixed_axis_covariance(r, cov)), cov)


def test_ros_covariance_is_that_of_fixed_axis_errors():
    """Monte Carlo: scatter of the position, and of the small rotation from the left."""
    rng = np.random.default_rng(4)
    pose = se3.exp([3.0, -2.0, 5.0, 0.7, -0.4, 1.2])
    half = rng.normal(size=(6, 6)) * 1e-3
    n = 40_000
    samples = pose @ se3.exp(rng.normal(size=(n, 6)) @ half.T)
    errors = np.concatenate(
        [samples[:, :3, 3] - pose[:3, 3], se3.log_so3(samples[:, :3, :3] @ pose[:3, :3].T)], axis=1
    )
    expected = odometry.fixed_axis_covariance(pose[:3, :3], half @ half.T)
    scale = np.sqrt(np.diag(expected))
    difference = (errors.T @ errors / n - expected) / np.outer(scale, scale)
    assert abs(difference).max() < 5 * np.sqrt(2 / n)


def test_tum_keeps_every_nanosecond(tmp_path: Path):
    writer = TumWriter(tmp_path / "t.tum")
    for i in range(3):
        writer.write(estimate(i))
    assert not (tmp_path / "t.tum").exists() and (tmp_path / "t.tum.part").read_text().count("\n") == 3
    writer.close()
    assert (tmp_path / "t.tum").read_text().startswith("1700000000.123456789 ")
    back = read_tum(tmp_path / "t.tum")
    assert back.stamps_ns.tolist() == [estimate(i).stamp_ns for i in range(3)]
    assert np.allclose(back.world_from_cam, [estimate(i).world_from_cam for i in range(3)], atol=1e-10)


def test_kitti_rows_are_the_upper_three_rows(tmp_path: Path):
    writer = KittiWriter(tmp_path / "t.kitti")
    for i in range(3):
        writer.write(estimate(i))
    writer.close()
    rows = np.loadtxt(tmp_path / "t.kitti")
    assert np.allclose(rows.reshape(3, 3, 4), [estimate(i).world_from_cam[:3] for i in range(3)], atol=1e-10)


@pytest.mark.parametrize("text", ["1 2 3", "a 1 2 3 0 0 0 1", "1.0 x 2 3 0 0 0 1"])
def test_a_line_that_is_no_pose_is_named(tmp_path: Path, text: str):
    (tmp_path / "t.tum").write_text(f"# comment\n{text}\n")
    with pytest.raises(InputError, match="line 2"):
        read_tum(tmp_path / "t.tum")


def test_evo_reads_the_odometry_and_the_text_files_straight(written: Path, tmp_path: Path):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    with rosbag2.Reader(written) as reader:
        read = file_interface.read_bag_trajectory(reader, "/stream_sfm/odometry")
    expected = np.array([estimate(i).world_from_cam for i in range(25)])
    assert np.allclose(read.poses_se3, expected, atol=1e-12)
    writers = TumWriter(tmp_path / "t.tum"), KittiWriter(tmp_path / "t.kitti")
    for writer in writers:
        for i in range(25):
            writer.write(estimate(i))
        writer.close()
    tum = file_interface.read_tum_trajectory_file(tmp_path / "t.tum")
    kitti = file_interface.read_kitti_poses_file(tmp_path / "t.kitti")
    assert np.allclose(tum.poses_se3, expected, atol=1e-9) and np.allclose(kitti.poses_se3, expected, atol=1e-9)


def test_rerun_finds_nothing_wrong(written: Path):
    mcap = [sys.executable, "-m", "rerun", "mcap"]
    if "check" not in subprocess.run([*mcap, "--help"], capture_output=True, text=True, timeout=60).stdout:
        pytest.skip("this rerun has no `mcap check`")
    done = subprocess.run([*mcap, "check", "--full", str(written)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("ok") == 7  # one a topic
