"""One camera: the motion up to scale, a status that says when scale is not observable, and "unscaled" everywhere."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.dense.surface import surface
from stream_sfm.evaluation.structure import structure_errors
from stream_sfm.evaluation.trajectory import ate_rmse_sim3_m, path_length_m
from stream_sfm.geometry import se3
from stream_sfm.logs.recording.stereo_log import StereoLog
from stream_sfm.results.estimates_reader import read_estimates
from stream_sfm.run.compare import compare
from tests.helpers.places import DEMO, ROOM
from tests.helpers.wall import PERIOD_NS, Wall, camera_path, rig
from tests.helpers.wall_log import LEFT, write_wall_log

MONO = sfm.Config(mono=True)
N = 36


@pytest.fixture(scope="module")
def room() -> StereoLog:
    return sfm.open_log(ROOM, mono=True)


@pytest.fixture(scope="module")
def frames(room) -> list[sfm.MonoFrame]:
    return [sfm.MonoFrame(f.stamp_ns, f.left) for f in room.frames(sfm.Selection(max_frames=N))]


@pytest.fixture(scope="module")
def truth(room) -> np.ndarray:
    return room.ground_truth().world_from_cam[:N]


@pytest.fixture(scope="module")
def estimates(room, frames) -> list[sfm.FrameEstimate]:
    engine = sfm.Engine(room.rig, MONO)
    return [engine.step(f) for f in frames]


def error_percent(estimates, truth) -> tuple[float, float]:
    """Position error after Sim(3) as a share of the path, and the metres of a unit."""
    error_m, scale = ate_rmse_sim3_m(np.stack([e.world_from_cam for e in estimates]), truth)
    return 100 * error_m / path_length_m(truth), scale


def test_the_path_is_right_up_to_scale(estimates, truth) -> None:
    """36 frames, 1.7 m with a turn: measured 0.05 %."""
    waiting = [e for e in estimates if not e.counts["used"]]
    k = len(waiting)
    assert 1 <= k <= 4 and waiting == estimates[:k]
    assert all(e.status == sfm.Status.INITIALISING and e.reason for e in waiting)
    assert all(np.array_equal(e.world_from_cam, np.eye(4)) for e in waiting)
    assert estimates[k].status == sfm.Status.INITIALISING and "unit of length" in estimates[k].reason
    assert all(e.status == sfm.Status.OK for e in estimates[k + 1 :])
    assert np.linalg.norm(estimates[k].world_from_cam[:3, 3]) == pytest.approx(1.0)  # the unit by definition
    percent, scale = error_percent(estimates[k:], truth[k:])
    assert percent < 0.25
    assert scale == pytest.approx(np.linalg.norm(truth[k][:3, 3]), rel=0.1)
    assert all(e.unscaled for e in estimates)


def test_a_drive_in_which_points_come_to_lie_behind_the_camera() -> None:
    """60 frames, in which somebody walks through the view: measured 0.43 %."""
    log = sfm.open_log(DEMO, mono=True)
    engine = sfm.Engine(log.rig, MONO)
    estimates = [engine.step(f) for f in log.frames(sfm.Selection(max_frames=60))]
    assert estimates[-1].status == sfm.Status.OK
    assert error_percent(estimates, log.ground_truth().world_from_cam[:60])[0] < 1


def test_structure_is_the_depth_of_the_scene_and_covariances_are_complete(room, estimates, truth) -> None:
    _, scale = error_percent(estimates[3:], truth[3:])
    for stamp_ns, depth_m in room.depths():
        found = next((e for e in estimates[3:] if e.stamp_ns == stamp_ns), None)
        if found is not None:
            metric = structure_errors(room.rig.left, scale * found.points_in_cam, scale**2 * found.cov_points, depth_m)
            assert len(metric.errors_m) > 40
            assert np.median(np.abs(metric.errors_m)) < 0.04  # of 2 to 6 m
    for e in estimates[3:]:
        assert np.linalg.eigvalsh(e.cov_pose).min() > 0 and np.linalg.eigvalsh(e.cov_points).min() > 0


def test_the_left_images_of_a_pair_give_the_same_bytes(frames, estimates) -> None:
    pair = sfm.Engine(sfm.open_log(ROOM).rig, MONO)
    for frame, expected in zip(frames[:8], estimates, strict=False):
        e = pair.step(sfm.StereoFrame(frame.stamp_ns, frame.left, np.zeros_like(frame.left)))
        assert e.world_from_cam.tobytes() == expected.world_from_cam.tobytes()
        assert e.cov_points.tobytes() == expected.cov_points.tobytes()


def test_while_it_stands_still_or_turns_scale_is_not_observable() -> None:
    wall, camera = Wall(5), rig().left
    engine = sfm.Engine(sfm.MonoRig(camera), MONO)
    poses = [np.eye(4)] * 6 + [se3.exp([0, 0, 0, 0, 0.004 * n, 0.002 * n]) for n in range(6)]
    moving = poses[-1] @ camera_path(8)[1:]
    estimates = [
        engine.step(sfm.MonoFrame(n * PERIOD_NS, wall.image(camera, pose))) for n, pose in enumerate([*poses, *moving])
    ]
    assert all(e.status == sfm.Status.INITIALISING for e in estimates[: len(poses)])
    assert all("too little parallax" in e.reason for e in estimates[1 : len(poses)])
    assert all(not len(e.track_ids) and np.isfinite(e.cov_pose).all() for e in estimates[: len(poses)])
    assert estimates[-1].status == sfm.Status.OK


def test_standing_still_in_a_map_keeps_pose_and_scale(room, frames) -> None:
    engine, rng = sfm.Engine(room.rig, MONO), np.random.default_rng(0)
    now = [engine.step(f) for f in frames[:12]]
    for n in range(1, 13):
        noisy = np.clip(frames[11].left + rng.normal(scale=2.0, size=frames[11].left.shape), 0, 255)
        now.append(engine.step(sfm.MonoFrame(frames[11].stamp_ns + n * 10**8, noisy.astype(np.uint8))))
    assert all(e.status == sfm.Status.OK for e in now[8:])
    moved = se3.log(se3.inverse(now[11].world_from_cam) @ now[-1].world_from_cam)
    assert np.linalg.norm(moved[:3]) < 0.1 and np.linalg.norm(moved[3:]) < 2e-3  # units; a frame is two


def test_lost_is_reported_and_the_unit_after_it_is_about_the_same(room, frames, truth) -> None:
    engine = sfm.Engine(room.rig, MONO)
    dark = [dataclasses.replace(f, left=np.zeros_like(f.left)) if 14 <= n < 17 else f for n, f in enumerate(frames)]
    now = [engine.step(f) for f in dark[:30]]
    assert [e.status for e in now[14:17]] == [sfm.Status.LOST] * 3
    assert all("black" in e.reason for e in now[14:17])
    again = next(n for n in range(17, 30) if now[n].status != sfm.Status.LOST)
    # a few frames after 17
    assert again < 22 and now[again].status == sfm.Status.INITIALISING and "as far away" in now[again].reason
    assert all(e.status == sfm.Status.OK for e in now[again + 1 :])
    _, before = error_percent(now[3:14], truth[3:14])
    percent, after = error_percent(now[again:], truth[again:30])
    # of the path; the unit is that of the last depths seen
    assert percent < 1 and after == pytest.approx(before, rel=0.25)
    assert now[again].cov_pose[0, 0] > 100 * now[13].cov_pose[0, 0]  # three frames of unknown motion


def test_what_needs_two_cameras_refuses_one(tmp_path, cli) -> None:
    with pytest.raises(sfm.ConfigError, match="method ekf needs two cameras"):
        sfm.Config(mono=True, method="ekf")
    pair, one = sfm.open_log(ROOM), sfm.open_log(ROOM, mono=True)
    with pytest.raises(sfm.ConfigError, match="compare needs two cameras"):
        compare(pair, config=MONO)
    with pytest.raises(sfm.ConfigError, match="a surface needs two cameras"):
        surface(pair, 0, MONO)
    with pytest.raises(sfm.ConfigError, match="opened for one camera"):
        _ = one.stereo_rig
    cli("batch", ROOM, "--out", tmp_path / "b", "--set", "mono=true", code=2)


@pytest.fixture(scope="module")
def one_camera_log(tmp_path_factory) -> Path:
    return write_wall_log(tmp_path_factory.mktemp("logs") / "one.mcap", n=16, right=False)


def test_a_log_of_one_camera_is_replayed_and_every_output_says_unscaled(one_camera_log, tmp_path, cli) -> None:
    out = tmp_path / "out"
    summary = cli("replay", one_camera_log, "--mono", "--json", "--out", out).json
    assert summary["unscaled"] is True and "unscaled" in summary["unit_of_length"]
    assert summary["frames"]["paired"] == summary["frames"]["estimated"] == 16
    truth = summary["ground_truth"]
    assert set(truth) - {"frames_ignored"} == {
        "ate_rmse_sim3_m", "ate_sim3_percent", "metres_per_unit", "true_path_length_m", "frames_compared"
    }  # fmt: skip
    assert truth["true_path_length_m"] == pytest.approx(path_length_m(camera_path(16)), rel=1e-6)
    assert 0 < truth["ate_rmse_sim3_m"] < truth["true_path_length_m"] and truth["metres_per_unit"] > 0
    assert all(record.unscaled for record in read_estimates(out / "estimates.mcap"))
    first, *lines = (out / "trajectory.tum").read_text().splitlines()
    assert first.startswith("# unscaled") and len(lines) == 16
    assert sfm.read_config(out / "config.toml") == MONO
    assert "unscaled" in cli("replay", one_camera_log, "--mono", "--max-frames", "3", "--out", out).out


def test_the_camera_and_its_calibration_are_found(one_camera_log, tmp_path) -> None:
    assert sfm.open_log(one_camera_log, mono=True).left_topic == LEFT
    pair = sfm.open_log(ROOM)
    one = sfm.open_log(ROOM, mono=True)
    assert one.left_topic == one.right_topic == pair.left_topic and isinstance(one.rig, sfm.MonoRig)
    assert np.array_equal(one.rig.left.K, pair.rig.left.K) and one.rig.left.D == pair.rig.left.D
    named = sfm.open_log(ROOM, left=pair.right_topic, mono=True)
    assert np.array_equal(named.rig.left.K, pair.rig.right.K)
    file = tmp_path / "one.toml"
    file.write_text(sfm.MonoRig(pair.rig.right).to_toml())
    assert "right" not in file.read_text()
    given = sfm.open_log(one_camera_log, mono=True, calibration=file)
    assert np.array_equal(given.rig.left.K, pair.rig.right.K)
    with pytest.raises(sfm.ConfigError, match=r"section \[right\] is missing"):
        sfm.StereoRig.from_calibration(file)
