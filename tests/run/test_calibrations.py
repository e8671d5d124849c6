"""Calibrations that change during a log, which continues in the same world, and calibrations with realistic errors."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.config import MotionConfig, RigConfig
from stream_sfm.geometry import se3
from stream_sfm.run.world import World
from stream_sfm.types import Observations
from tests.helpers.estimators import nees
from tests.helpers.stereo_logs import LogWriter, infos_of, write_pair
from tests.helpers.wall import PERIOD_NS, Wall, camera_path, rig
from tests.helpers.wall_log import START_NS
from tools.decalibrated import KINDS, poses_nees

FRAMES, CHANGE = 20, 10
SEEN = 24  # frames of the rig whose calibration is wrong
ZOOM = 1.15


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log before a wall whose cameras zoom in, and say so, from frame CHANGE on."""
    path = tmp_path_factory.mktemp("zoom") / "zoom.mcap"
    first = rig()
    k = first.left.K * [[ZOOM], [ZOOM], [1]]
    k[:2, 2] = first.left.K[:2, 2]
    camera = replace(first.left, K=k)
    rigs, wall, log = (first, sfm.StereoRig(camera, camera, first.right_from_left)), Wall(5), LogWriter(path)
    for n, pose in enumerate(camera_path(FRAMES)):
        stereo, time = rigs[n >= CHANGE], START_NS + n * PERIOD_NS
        write_pair(log, "foxglove", time, wall.frame(stereo, pose, n).images, infos_of(stereo), "mono8")
    log.close()
    return path


def test_a_run_goes_on_with_the_next_calibration(changed: Path, tmp_path: Path) -> None:
    done = sfm.replay(changed, tmp_path / "out")
    assert done.summary["complete"] and "changes (K, P)" in " ".join(done.summary["warnings"])
    results = sfm.read_results(tmp_path / "out")
    assert len(results.statuses) == FRAMES and results.statuses[CHANGE] == "lost"
    assert set(results.statuses[CHANGE + 1 :]) == {"ok"}
    truth = camera_path(FRAMES)
    for estimate in sfm.read_estimates(tmp_path / "out/estimates.mcap"):
        n = estimate.frame_index
        assert n == 0 or nees(estimate.world_from_cam, estimate.cov_pose, truth[n]) < 22.5  # χ² of 6: 99.9 %
    std_m = np.sqrt(np.trace(results.cov_pose[:, :3, :3], axis1=1, axis2=2))
    assert std_m[CHANGE] > std_m[CHANGE - 1]
    assert (std_m[CHANGE + 1 :] >= std_m[CHANGE]).all()  # what was not seen of one motion stays uncertain


def test_where_a_map_would_not_fit_the_run_ends(changed: Path) -> None:
    done = sfm.replay(changed, config=sfm.Config(mono=True))
    assert not done.summary["complete"] and len(done.trajectory) == CHANGE


def placed(start: np.ndarray, cov: np.ndarray, estimate: sfm.FrameEstimate) -> sfm.FrameEstimate:
    """The estimate as the second frame of a map that begins at `start`."""
    world, none = World(MotionConfig()), np.empty(0, np.int64)
    seen = Observations(0, 7, none, np.empty((0, 4)), np.empty((0, 4, 4)))
    world.place(replace(estimate, world_from_cam=start, cov_pose=cov), seen)
    world.restart(1)
    first = world.place(estimate, seen)
    assert first.status is sfm.Status.LOST and np.allclose(first.cov_pose, cov)
    return world.place(replace(estimate, frame_index=1), seen)


def test_covariances_in_the_world_follow_from_where_the_map_begins() -> None:
    """Against central differences by the pose at which it begins."""
    engine, wall = sfm.Engine(rig()), Wall(5)
    estimate = [engine.step(wall.frame(rig(), pose, n)) for n, pose in enumerate(camera_path(3))][-1]
    start, step = se3.exp([1, 2, 3, 0.3, -0.2, 0.5]), 1e-6
    zero, some = np.zeros((6, 6)), np.diag(np.arange(1.0, 7)) ** 2 * 1e-4
    here = placed(start, zero, estimate)
    poses, points = np.empty((6, 6)), np.empty((*here.points_in_world.shape, 6))
    for k, tangent in enumerate(step * np.eye(6)):
        there, back = (placed(start @ se3.exp(sign * tangent), zero, estimate) for sign in (1, -1))
        poses[:, k] = se3.log(se3.inverse(back.world_from_cam) @ there.world_from_cam) / (2 * step)
        points[..., k] = (there.points_in_world - back.points_in_world) / (2 * step)
    found = placed(start, some, estimate)
    assert np.allclose(found.cov_pose, here.cov_pose + poses @ some @ poses.T, rtol=1e-4, atol=1e-9)
    expected = here.cov_points_in_world + points @ some @ np.swapaxes(points, 1, 2)
    assert np.allclose(found.cov_points_in_world, expected, rtol=1e-4, atol=1e-9)
    assert found.frame_index == 2 and {f.name for f in fields(found)} == {f.name for f in fields(estimate)}


@pytest.fixture(scope="module")
def frames() -> list[sfm.StereoFrame]:
    return Wall(7).frames(rig(), camera_path(SEEN))


def mean_nees(frames: list[sfm.StereoFrame], kind: str, sign: int, exact: bool) -> float:
    engine = sfm.Engine(KINDS[kind](rig(), sign), sfm.Config(rig=RigConfig(exact=exact)))
    return float(poses_nees([engine.step(frame) for frame in frames], camera_path(SEEN)).mean())


@pytest.mark.parametrize(("kind", "sign"), [(kind, (-1) ** n) for n, kind in enumerate(KINDS)])
def test_a_wrong_calibration_leaves_the_covariance_true(frames: list[sfm.StereoFrame], kind: str, sign: int) -> None:
    """6 is expected of the mean NEES, and 12 is √2 in σ; taken for exact the same calibration has up to 59 000."""
    assert mean_nees(frames, kind, sign, exact=False) < 12
    if kind in ("yaw", "right centre x", "baseline"):  # so the bound can fail
        assert mean_nees(frames, kind, sign, exact=True) > 12
