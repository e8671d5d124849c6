"""A textured body passes in front of a wall: which motion is followed, and the status while the wall is hidden."""

from itertools import pairwise

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.camera.models import Camera
from stream_sfm.geometry import se3
from tests.helpers.estimators import nees
from tests.helpers.wall import Wall, camera_path, rig

STEREO = rig()
BODY_M = 1.5  # its distance, half of that of the wall
HALF_VIEW_M = BODY_M * 160 / 260


class Passing(Wall):
    """A wall, and in front of it a flat body of some width whose right edge is at x = `edge_m` of the first camera."""

    def __init__(self, width_m: float, body_m: float) -> None:
        super().__init__(0)
        self.width_m, self.body_m, self.edge_m, self.body = width_m, body_m, 0.0, Wall(7)

    def image(self, camera: Camera, world_from_cam: np.ndarray, noise: float = 1.0) -> np.ndarray:
        """The image with the body's columns in front of the wall; its texture moves with its edge."""
        self.body.world_from_wall = se3.exp([self.edge_m, 0, self.body_m, 0, 0, 0])
        edges = np.array([[self.edge_m - self.width_m, 0, self.body_m], [self.edge_m, 0, self.body_m]])
        in_cam = se3.transform(se3.inverse(world_from_cam), edges)
        left, right = camera.K[0, 0] * in_cam[:, 0] / in_cam[:, 2] + camera.K[0, 2]
        columns = np.arange(camera.width)
        behind, before = (
            super().image(camera, world_from_cam, noise),
            self.body.image(camera, world_from_cam, noise),
        )
        return np.where((columns > left) & (columns < right), before, behind)


def estimated(width_m: float, edges_m: np.ndarray, body_m: float = BODY_M) -> list[sfm.FrameEstimate]:
    """Estimates of all frames, each consistent with its σ."""
    engine, scene, poses = sfm.Engine(STEREO), Passing(width_m, body_m), camera_path(len(edges_m))
    estimates = []
    for index, (pose, scene.edge_m) in enumerate(zip(poses, edges_m, strict=True)):
        estimates.append(engine.step(scene.frame(STEREO, pose, index)))
        if index:
            assert nees(estimates[-1].world_from_cam, estimates[-1].cov_pose, pose) < 60  # χ² of six: P < 1e-10
    return estimates


def test_a_body_that_comes_to_cover_two_thirds_is_not_followed() -> None:
    edges_m = -HALF_VIEW_M + np.maximum(0, np.arange(27) - 5) * 0.06
    assert edges_m[-1] > 0.3 * HALF_VIEW_M  # 65 % of the image and more
    estimates = estimated(5.0, edges_m)
    assert all(e.status == sfm.Status.OK for e in estimates[1:])


def test_a_body_at_the_depth_of_the_background_makes_every_frame_ambiguous() -> None:
    """It is hardly nearer than the wall, and there from the start: both motions are covered in every frame."""
    estimates = estimated(5.0, np.arange(12) * 0.02, 2.5)
    assert all(e.status == sfm.Status.DEGRADED for e in estimates[1:])
    assert all("two rigid motions agree with the views" in e.reason for e in estimates[1:])
    relative = estimates[-1].relative
    assert relative is not None
    poses = camera_path(12)
    for index, pose, cov in zip(relative.frame_indices, relative.frame_from_newest, relative.cov, strict=True):
        assert nees(pose, cov, se3.inverse(poses[index]) @ poses[11]) < 60
        assert np.sqrt(np.trace(cov[:3, :3])) > 0.015 * (11 - index)  # metres, the motion of the body per frame


def test_a_small_body_that_is_there_from_the_start_does_no_harm() -> None:
    estimates = estimated(0.35, -0.5 * HALF_VIEW_M + np.arange(12) * 0.02)
    assert all(e.status == sfm.Status.OK for e in estimates[1:])


@pytest.mark.parametrize("share", [0.3, 0.4])
def test_a_body_in_front_of_the_wall_from_the_start_is_recognised(share: float) -> None:
    """It covers a `share` of the view, has as many votes as the wall's points, and is clearly nearer than these."""
    width_m = 2 * HALF_VIEW_M * share
    estimates = estimated(width_m, -0.3 * HALF_VIEW_M + np.arange(16) * 0.02)
    assert sum(e.status != sfm.Status.OK for e in estimates[1:]) <= 1


def test_a_body_that_hides_the_wall_is_not_taken_for_it() -> None:
    """Every frame is reported correctly: lost while only the body is in view, and all poses consistent with their σ."""
    edges_m = -HALF_VIEW_M + np.maximum(0, np.arange(40) - 6) * 0.16
    estimates = estimated(2.4 * HALF_VIEW_M, edges_m)
    covered = (edges_m > HALF_VIEW_M) & (edges_m - 2.4 * HALF_VIEW_M < -HALF_VIEW_M)
    assert covered.sum() >= 2
    statuses = [e.status for e in estimates]
    assert all(statuses[k] == sfm.Status.LOST for k in np.flatnonzero(covered))
    assert any("background occluded" in e.reason for e in estimates)
    assert statuses[-1] == sfm.Status.OK


def test_a_start_with_a_body_that_covers_two_thirds_is_uncertain() -> None:
    """Most of the views have its motion: no frame is ok until it has gone, and then σ covers both motions."""
    edges_m = 0.575 * HALF_VIEW_M + np.cumsum(np.where(np.arange(34) < 8, 0.02, 0.25))
    estimates = estimated(1.35 * HALF_VIEW_M, edges_m)
    assert all(e.status == sfm.Status.DEGRADED for e in estimates[1:8])
    assert all("agree with the motion since the start" in e.reason for e in estimates[1:8])
    assert estimates[-1].status == sfm.Status.OK


@pytest.mark.parametrize("speed_m", [0.05, 0.08])
def test_a_camera_that_stands_is_known_to_stand_once_the_wall_shows_behind_a_body(speed_m: float) -> None:
    """Images cannot tell before; then what comes into view behind the body is at rest, while most tracks are on it."""
    edges_m = HALF_VIEW_M + 0.3 - np.arange(30) * speed_m
    engine, scene, estimates = sfm.Engine(STEREO), Passing(5.0, 0.9), []
    for index, scene.edge_m in enumerate(edges_m):
        estimates.append(engine.step(scene.frame(STEREO, np.eye(4), index)))
    found = next(k for k, e in enumerate(estimates) if "was that of an object in front" in e.reason)
    statuses = [e.status for e in estimates]
    assert all(status is sfm.Status.OK for status in statuses[1:found])  # and wrong, which cannot be avoided
    ok = statuses.index(sfm.Status.OK, found)
    assert ok - found <= 4 and all(status is sfm.Status.OK for status in statuses[ok:])
    assert all(nees(e.world_from_cam, e.cov_pose, np.eye(4)) < 22.5 for e in estimates[found:])
    assert np.linalg.norm(estimates[-1].cov_pose[:3, :3]) ** 0.5 > speed_m * found / 3  # the path until then stays in σ
    moved = [se3.log(se3.inverse(a.world_from_cam) @ b.world_from_cam)[:3] for a, b in pairwise(estimates[ok:])]
    assert np.linalg.norm(moved, axis=1).max() < 0.2 * speed_m
