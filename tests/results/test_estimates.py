"""Other tools can read what a run writes: round trips, conventions, crashes, second opinions."""

import re
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory as Ros2DecoderFactory
from rosbags.rosbag2 import Reader

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.config import Config, RigConfig, config_to_toml
from stream_sfm.errors import InputError, LogError
from stream_sfm.geometry import se3
from stream_sfm.logs.sources.pose_files import read_tum
from stream_sfm.results.estimates_reader import read_clouds, read_estimates
from stream_sfm.results.estimates_writer import EstimatesWriter
from stream_sfm.results.frames import fixed_axis_covariance
from stream_sfm.results.run_results import read_results
from stream_sfm.results.trajectory_files import NAMES, lines_of
from stream_sfm.rig_model.estimate import RigEstimate
from stream_sfm.rig_model.terms import CAUSES, TERMS, prior_std
from stream_sfm.types import FrameEstimate, Status
from tests.helpers.places import ROOM

START_NS = 1_700_000_000_123_456_789
FRAMES = 25


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
        frame_index=i, stamp_ns=START_NS + i * 100_000_000, status=Status.OK if i else Status.INITIALISING,
        reason="" if i else "first frame", world_from_cam=pose, cov_pose=half @ half.T,
        track_ids=np.arange(i, i + points, dtype=np.int64), points_in_cam=in_cam, cov_points=cov,
        points_in_world=se3.transform(pose, in_cam), cov_points_in_world=cov, window_frame_indices=np.array([i]),
        window_world_from_cam=pose[None], ended_ids=np.array([i - 1] if i else [], dtype=np.int64),
        ended_points_in_world=np.full((1 if i else 0, 3), float(i)),
        ended_cov_points_in_world=np.tile(np.eye(3), (1 if i else 0, 1, 1)),
        counts={"tracked": points, "new": 1, "used": points, "rejected": 0}, nis=3.5, nis_dof=4,
        timings_ms={"frontend": 1.0, "estimator": 2.0},
    )  # fmt: skip


def write(path: Path, estimates, *settings) -> Path:
    """A file of estimates; `settings`: those of `EstimatesWriter`, else the default ones."""
    writer = EstimatesWriter(path, rig(), *(settings or [Config()]))
    for e in estimates:
        writer.write(e)
    writer.close()
    return path


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("out") / "estimates.mcap", [estimate(i) for i in range(FRAMES)])


def decoded(path: Path) -> dict[str, tuple[str, object, object]]:
    """The last message of each topic, decoded by the MCAP project's library for ROS 2."""
    with open(path, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[Ros2DecoderFactory()])
        return {
            channel.topic: (schema.name, message, content)
            for schema, channel, message, content in reader.iter_decoded_messages()
        }


def matrix(place, turn) -> np.ndarray:
    """The motion (4, 4) of a translation and a quaternion of a message."""
    rotation = se3.matrix_from_quat_xyzw([turn.x, turn.y, turn.z, turn.w])
    return se3.from_rotation_translation(rotation, [place.x, place.y, place.z])


def test_every_topic_decodes_with_the_public_libraries_and_says_the_same(written: Path):
    last = decoded(written)
    e = estimate(FRAMES - 1)
    name, message, pose = last["/stream_sfm/pose"]
    assert name == "geometry_msgs/msg/PoseWithCovarianceStamped" and pose.header.frame_id == "map"
    assert (message.log_time, message.publish_time, message.sequence) == (e.stamp_ns, e.stamp_ns, FRAMES - 1)
    assert pose.header.stamp.sec * 10**9 + pose.header.stamp.nanosec == e.stamp_ns
    odom = last["/stream_sfm/odometry"][2]
    corrected, sent = last["/tf"][2].transforms
    assert (corrected.header.frame_id, corrected.child_frame_id) == ("map", "odom")
    for stamped in (odom, sent):
        assert (stamped.header.frame_id, stamped.child_frame_id) == ("odom", "left_camera")
    for given in (pose.pose, odom.pose):  # the covariance is turned into the axes of the world, and here back
        cov = fixed_axis_covariance(e.world_from_cam[:3, :3].T, np.array(given.covariance).reshape(6, 6))
        assert np.allclose(cov, e.cov_pose, atol=1e-15)
    said = [(p.pose.position, p.pose.orientation) for p in (pose.pose, odom.pose)]
    for place, turn in (*said, (sent.transform.translation, sent.transform.rotation)):
        assert np.allclose(matrix(place, turn), e.world_from_cam, atol=1e-12)
    assert odom.twist.covariance[0] == -1  # ROS: not estimated
    path = [matrix(p.pose.position, p.pose.orientation) for p in last["/stream_sfm/path"][2].poses]
    assert np.allclose(path, [estimate(i).world_from_cam for i in range(FRAMES)], atol=1e-12)
    timing = last["/stream_sfm/timing"][2]
    assert dict(zip(timing.timings_ms_names, timing.timings_ms, strict=True)) == e.timings_ms
    with open(written, "rb") as stream:
        reader = make_reader(stream)
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        (attachment,) = reader.iter_attachments()
    assert metadata["configuration"]["config.toml"] == config_to_toml(Config())
    assert metadata["stream_sfm"]["method"] == "cross-frame" and attachment.data.decode() == rig().to_toml()


def test_numbers_to_plot_are_single_fields(written: Path):
    now = decoded(written)["/stream_sfm/scalars"][2]
    e, before = estimate(FRAMES - 1), estimate(FRAMES - 2)
    moved = se3.inverse(before.world_from_cam) @ e.world_from_cam
    assert [now.x, now.y, now.z] == e.world_from_cam[:3, 3].tolist()
    assert now.speed == pytest.approx(np.linalg.norm(moved[:3, 3]) / 0.1)
    assert now.angular_speed_deg_s == pytest.approx(np.degrees(np.linalg.norm(se3.log_so3(moved[:3, :3]))) / 0.1)
    assert now.sigma_position == pytest.approx(np.sqrt(np.trace(e.cov_pose[:3, :3])))
    assert now.sigma_rotation_deg == pytest.approx(np.degrees(np.sqrt(np.trace(e.cov_pose[3:, 3:]))))
    assert (now.points_tracked, now.points_used, now.status, now.nis_per_dof) == (5, 5, 1, 3.5 / 4)
    places = np.array([estimate(i).world_from_cam[:3, 3] for i in range(FRAMES)])
    assert now.path_length == pytest.approx(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def test_a_file_of_an_earlier_version_is_refused_with_the_way_out(tmp_path: Path):
    with open(tmp_path / "old.mcap", "wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", library="stream_sfm 0.0")
        schema = writer.register_schema("stream_sfm.Estimate", "jsonschema", b"{}")
        channel = writer.register_channel("/stream_sfm/estimate", "json", schema)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(LogError, match=r"/stream_sfm/estimate is encoded as 'json'.*replay the log again"):
        list(read_estimates(tmp_path / "old.mcap"))


@pytest.mark.parametrize(
    ("earlier", "missing"),
    [
        ("without_motions", ("relative", "common", "rig")), ("without_rig", ("common", "rig")),
        ("without_timing", ("common",)), ("without_common_errors", ("common",)), ("without_rates", ()),
    ],
)  # fmt: skip
def test_files_of_each_earlier_schema_are_read(earlier: str, missing: tuple[str, ...], tmp_path: Path):
    """Three frames of the sample log, written by the versions before each new field; named by what they lack."""
    warnings: list[str] = []
    with ZipFile(Path(__file__).with_name("earlier.zip")) as archive:
        frames = list(read_estimates(archive.extract(f"{earlier}.mcap", tmp_path), warnings))
    assert not warnings and [e.frame_index for e in frames] == [0, 1, 2]
    for e in frames:
        assert np.allclose(se3.inverse(e.world_from_cam) @ e.world_from_cam, np.eye(4))
        assert np.allclose(e.window_world_from_cam[-1], e.world_from_cam, rtol=0, atol=1e-12)
    last = frames[-1]
    assert {name for name in ("relative", "common", "rig") if getattr(last, name) is None} == set(missing)
    if last.relative is not None:  # its motions lead to the poses of the window
        before, now = last.window_world_from_cam
        to = last.relative.frame_from_newest
        assert last.relative.frame_indices.tolist() == [0, 1] and last.relative.cov.shape == (2, 6, 6)
        assert np.allclose(before @ to[1], now, atol=1e-9)
    if last.common is not None:
        m = len(last.common.mean)
        assert last.common.jacobian.shape == (6, m) and last.relative.common_jacobian.shape == (2, 6, m)
    if last.rig is not None:
        assert last.rig.findings() == [] and len(last.rig.mean) == len(TERMS)


def test_what_is_known_of_the_rig_comes_back_with_its_findings(tmp_path: Path):
    """Each physical term is written; only what terms of different causes have in common is not."""
    std = 0.01 * prior_std(RigConfig())
    mean = 8 * std
    rig_errors = RigEstimate(mean, np.diag(std**2), 1.0, mean, np.diag(std**2), std, evidence=mean / std)
    write(tmp_path / "estimates.mcap", [replace(estimate(0), rig=rig_errors)])
    (read,) = read_estimates(tmp_path / "estimates.mcap")
    assert read.rig is not None and len(read.rig.findings()) == len(CAUSES)
    assert read.rig.findings() == rig_errors.findings()
    assert np.allclose(read.rig.mean, mean, rtol=1e-12) and np.allclose(read.rig.cov, rig_errors.cov, rtol=1e-9)


@pytest.mark.parametrize("read", [read_estimates, read_clouds])
def test_a_file_of_something_else_is_not_an_empty_run(read):
    with pytest.raises(LogError, match=r"has no messages on /stream_sfm/\w+, but on /camera/left/.*: give the est"):
        list(read(ROOM))


def test_numbers_that_are_not_finite_come_back_as_they_were(tmp_path: Path):
    lost = replace(estimate(0), cov_pose=np.full((6, 6), np.inf), status=Status.LOST)
    path = write(tmp_path / "estimates.mcap", [lost])
    assert np.isposinf(read_results(tmp_path).cov_pose).all()
    assert np.isnan(decoded(path)["/stream_sfm/odometry"][2].pose.covariance).all()


def test_damage_is_an_error_or_a_warning_and_the_rest_is_right(written: Path, tmp_path: Path):
    """Three bits are flipped anywhere: each frame is as it was written or missing, and what is missing is told."""
    rng, whole, damaged = np.random.default_rng(8), written.read_bytes(), tmp_path / "estimates.mcap"
    told = 0
    for _ in range(60):
        content = bytearray(whole)
        for at in rng.integers(8, len(whole), 3):
            content[at] ^= 1 << rng.integers(8)
        damaged.write_bytes(content)
        try:
            run = read_results(tmp_path)
            points, of_map = run.points, run.map_points
        except InputError:
            told += 1
            continue
        frames = run.table["frame_index"].tolist()
        for i, pose in zip(frames, run.world_from_cam, strict=True):
            assert np.array_equal(pose, estimate(i).world_from_cam)
        if len(frames) < FRAMES or len(points) < 5 * FRAMES or len(of_map) < FRAMES + 4:
            assert run.warnings
            told += 1
            with pytest.raises(LogError, match=re.escape(str(damaged))):
                [*read_estimates(damaged), *read_clouds(damaged), *read_clouds(damaged, "/stream_sfm/map")]
    assert 20 < told < 60  # most of the bytes are in chunks, which have a checksum


def test_evo_reads_the_odometry_and_the_text_files_straight(written: Path, tmp_path: Path):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    expected = np.array([estimate(i).world_from_cam for i in range(FRAMES)])
    for topic in ("/stream_sfm/odometry", "/stream_sfm/pose"):
        with Reader(written) as reader:
            read = file_interface.read_bag_trajectory(reader, topic)
        assert np.allclose(read.poses_se3, expected, atol=1e-12), topic
    for name, lines in zip(NAMES, zip(*(lines_of(estimate(i)) for i in range(FRAMES)), strict=True), strict=True):
        (tmp_path / name).write_text("".join(lines))
    assert read_tum(tmp_path / "trajectory.tum").stamps_ns.tolist() == [estimate(i).stamp_ns for i in range(FRAMES)]
    tum = file_interface.read_tum_trajectory_file(tmp_path / "trajectory.tum")
    kitti = file_interface.read_kitti_poses_file(tmp_path / "trajectory.kitti")
    assert np.allclose(tum.poses_se3, expected, atol=1e-9) and np.allclose(kitti.poses_se3, expected, atol=1e-9)
