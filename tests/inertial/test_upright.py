"""A world whose z axis is up: its axes, its covariance, and the results of a replay in it."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.inertial.upright import Upright
from stream_sfm.results.frames import RosFrames
from tests.helpers.imu_log import STEP, write_imu_log

BASE_FROM_CAM = RosFrames(sfm.RosConfig(base_frame="base", camera_x_m=0.3, camera_pitch_deg=25)).fixed_from_world
GRAVITY = 9.81


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    return write_imu_log(tmp_path_factory.mktemp("imu"))


@pytest.fixture(scope="module")
def upright(logs, tmp_path_factory):
    at_once = "rules.inertia.std_any_tilt_rad=0"  # half a second of samples proves nothing
    config = sfm.read_config(None, ["ros.gravity=true", at_once])
    return sfm.replay(logs[0], tmp_path_factory.mktemp("run") / "out", config)


def random_case(seed: int):
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(9, 9)) * 1e-3
    half[6:] *= 10
    gravity = rng.normal(size=3)
    return se3.exp(rng.normal(size=6)), GRAVITY * gravity / np.linalg.norm(gravity), half


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("fixed", [None, BASE_FROM_CAM])
def test_z_is_up_and_the_pose_has_the_covariance_of_its_errors(seed, fixed):
    """Monte Carlo: the true pose, levelled by true gravity with the same heading, against the estimated one."""
    pose, gravity, half = random_case(seed)
    given = {} if fixed is None else {"fixed_from_world": fixed}
    found = Upright.of(pose, gravity, half @ half.T, **given)
    level = found.upright_from_world
    assert np.allclose(level[:3, :3] @ pose[:3, :3] @ -gravity, [0, 0, GRAVITY], atol=1e-12)
    n, rng = 20_000, np.random.default_rng(99)
    drawn = rng.normal(size=(n, 9)) @ half.T
    true, true_gravity = pose @ se3.exp(drawn[:, :6]), gravity + drawn[:, 6:]
    # nearly z: the least turn to z has no heading
    up = -(level[:3, :3] @ true[:, :3, :3] @ true_gravity[..., None])[..., 0]
    across = np.cross(up, [0, 0, 1.0])
    sine = np.linalg.norm(across, axis=1)
    turn = np.zeros((n, 6))
    turn[:, 3:] = across * (np.arctan2(sine, up[:, 2]) / sine)[:, None]
    true_level = se3.exp(turn) @ level
    errors = se3.log(se3.inverse(level @ pose) @ true_level @ true)
    turns = se3.log(se3.inverse(level) @ true_level)
    for drawn_errors, cov in ((errors, found.cov_pose), (turns, found.cov)):
        scale = np.sqrt(np.diag(cov))
        scale = np.where(scale > 1e-9, scale, 1e-9)
        off = abs(drawn_errors.T @ drawn_errors / n - cov) / np.outer(scale, scale)
        assert off.max() < 6 * np.sqrt(2 / n) + 0.01  # standard errors, and the second order


def test_upside_down_is_not_an_exception():
    camera = se3.inverse(BASE_FROM_CAM)
    for sign in (1.0, -1.0):
        gravity = camera[:3, :3].T @ (BASE_FROM_CAM[:3, :3].T @ [0, 0, sign * GRAVITY])
        level = Upright.of(camera, gravity, np.eye(9), BASE_FROM_CAM).upright_from_world[:3, :3]
        assert np.allclose(level @ camera[:3, :3] @ -gravity, [0, 0, GRAVITY])
        assert np.allclose(level @ level.T, np.eye(3)) and np.linalg.det(level) > 0


def test_a_replay_writes_its_poses_in_a_world_whose_z_is_up(upright):
    """The wall's world has y downwards, so that of the truth is turned by the axes alone."""
    summary, poses = upright.summary["imu"], upright.in_gravity
    std = summary["std_up_in_world_rad"]
    assert 0 < std < 0.05 and np.arccos(-summary["up_in_world"][1]) < 3 * std
    turn = np.array(summary["gravity_from_world"])
    assert np.allclose(poses.world_from_cam, turn @ upright.trajectory.world_from_cam)
    lines = (upright.out_dir / "trajectory_gravity.tum").read_text().splitlines()
    assert np.allclose([float(x) for x in lines[-1].split()[1:4]], poses.world_from_cam[-1, :3, 3], atol=1e-9)
    travelled = poses.world_from_cam[-1, :3, 3]
    truth = se3.exp(STEP * (len(poses) - 1))[:3, 3]
    axes = RosFrames(sfm.RosConfig(z_up=True)).fixed_from_world
    assert np.linalg.norm(travelled - axes[:3, :3] @ truth) < 3 * std * np.linalg.norm(truth) + 0.002
    larger = np.linalg.eigvalsh(poses.cov_pose - upright.trajectory.cov_pose)
    assert larger.min() > -1e-12 and np.allclose(larger.max(axis=1), larger.max(axis=1)[0], rtol=0.2)


def test_the_map_frame_of_ros_is_upright_by_each_frames_gravity(upright):
    estimates = list(sfm.read_results(upright.out_dir).estimates())
    with (upright.out_dir / "estimates.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        said = [m for *_, m in reader.iter_decoded_messages(topics=["/stream_sfm/pose"])]
    for estimate, message in zip(estimates[1:], said[1:], strict=True):
        q = message.pose.pose.orientation
        turn = se3.matrix_from_quat_xyzw(np.array([q.x, q.y, q.z, q.w]))
        gravity = estimate.inertial.gravity
        assert np.allclose(turn @ gravity / np.linalg.norm(gravity), [0, 0, -1], atol=1e-9)
        about_z_last = np.reshape(message.pose.covariance, (6, 6))[3:5, 3:5]
        assert np.sqrt(np.linalg.eigvalsh(about_z_last)[-1]) == pytest.approx(estimate.inertial.std_tilt_rad, rel=1e-3)


def test_the_other_results_are_the_same_bytes(logs, upright, tmp_path):
    plain = sfm.replay(logs[0], tmp_path / "plain")
    assert plain.in_gravity is None and not (plain.out_dir / "trajectory_gravity.tum").exists()
    for name in ("trajectory.tum", "trajectory.csv"):
        assert (plain.out_dir / name).read_bytes() == (upright.out_dir / name).read_bytes()


@pytest.mark.parametrize(
    "log, settings, further, why",
    [
        (1, [], {}, "wall.mcap has no inertial samples"),
        (0, ["imu.enabled=false"], {}, "switched off: set imu.enabled"),
        (0, ["mono=true"], {}, "use both cameras"),
        (0, ['method="frame-to-frame"'], {}, "the method frame-to-frame takes no inertial samples"),
        (0, [], {"save_map": "map.bin"}, "a map of places has a world of its own"),
    ],
)
def test_a_run_that_cannot_know_is_refused_before_it_begins(logs, tmp_path, log, settings, further, why):
    config = sfm.read_config(None, ["ros.gravity=true", *settings])
    further = {name: tmp_path / value for name, value in further.items()}
    with pytest.raises(sfm.ConfigError, match=f"cannot be made upright by gravity: .*{why}"):
        sfm.replay(logs[log], tmp_path / "out", config, **further)
    assert list(Path(tmp_path).iterdir()) == []


def test_the_option_sets_it_and_can_take_it_back():
    from stream_sfm.cli.options import Settings

    assert Settings().read(world="gravity").ros.gravity
    assert not Settings(set=["ros.gravity=true"]).read(world="camera").ros.gravity
    assert Settings(set=["ros.gravity=true"]).read().ros.gravity
