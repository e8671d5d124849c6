"""Whether a place is the same, and the covariance of the motion between two views of it."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.camera.rectification import Rectifier
from stream_sfm.geometry import se3
from stream_sfm.geometry.point_views import PointViews
from stream_sfm.geometry.resection import Resection, resect
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.places.keyframes import make_keyframe
from stream_sfm.places.verifying import Seen, Verifier, _halves_apart, matches
from tests.helpers.wall import Wall, rig

SECOND = se3.exp([0.25, -0.1, 0.2, 0.05, -0.06, 0.1])  # first from second camera
STD_PX = 0.1


@pytest.fixture(scope="module")
def projection() -> StereoProjection:
    return Rectifier(rig()).projection


def seen(wall: Wall, pose: np.ndarray, projection: StereoProjection) -> Seen:
    """A keyframe of the wall from a pose, with points on a grid that err as views of STD_PX."""
    stereo = rig()
    frame = wall.frame(stereo, pose, 0)
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(20, 300, 10), np.linspace(20, 220, 8)))
    wall_from_cam = se3.inverse(wall.world_from_wall) @ pose
    rays = np.stack([(u - projection.cx_left_px), (v - projection.cy_px), np.full(u.shape, projection.f_px)], axis=1)
    rays /= projection.f_px
    depth = -wall_from_cam[2, 3] / (rays @ wall_from_cam[2, :3])
    points = rays * depth[:, None]
    j = projection.jacobian(points)
    cov = STD_PX**2 * np.linalg.inv(np.swapaxes(j, 1, 2) @ j)
    points = projection.triangulate(projection.project(points) + STD_PX * wall.rng.normal(size=(len(points), 4)))
    return Seen(make_keyframe(frame.images, projection, 0, 0, pose, points, cov), frame.images)


def test_the_motion_between_two_views_and_its_covariance(projection: StereoProjection) -> None:
    """Monte Carlo over noise of images and points: right, and no surer than it is."""
    verifier, nees = Verifier(projection), []
    for seed in range(12):
        wall = Wall(seed)
        found = verifier.motion(seen(wall, np.eye(4), projection).keyframe, seen(wall, SECOND, projection))
        assert found is not None
        error = se3.log(se3.inverse(found.earlier_from_newest) @ SECOND)
        assert np.linalg.norm(error[:3]) < 0.02 and np.linalg.norm(error[3:]) < 0.005
        nees.append(error @ np.linalg.solve(found.cov, error))
    # six is expected of exact σ; ours are cautious, because surfaces may be slanted more than this wall
    assert 0.3 < np.mean(nees) < 9.0


def test_other_places_are_not_verified(projection: StereoProjection) -> None:
    first, other = seen(Wall(1), np.eye(4), projection), seen(Wall(2), np.eye(4), projection)
    assert Verifier(projection).motion(first.keyframe, other) is None


def test_where_no_feature_matches_a_prediction_takes_the_place_of_it_and_proves_nothing(
    projection: StereoProjection,
) -> None:
    first, second, other = (seen(Wall(s), pose, projection) for s, pose in ((1, np.eye(4)), (1, SECOND), (2, SECOND)))
    unlike = replace(first.keyframe, descriptors=255 - second.keyframe.descriptors[:1].repeat(20, axis=0))
    near = SECOND @ se3.exp([0.01, -0.01, 0, 0.002, 0, 0])
    verifier = Verifier(projection)
    assert verifier.motion(unlike, second) is None
    found = verifier.motion(unlike, second, near)
    assert found is not None
    assert np.linalg.norm((se3.inverse(found.earlier_from_newest) @ SECOND)[:3, 3]) < 0.02
    assert verifier.motion(unlike, other, near) is None


def test_views_from_too_far_are_not_verified(projection: StereoProjection) -> None:
    wall = Wall(3)
    far = seen(wall, se3.exp([1.8, 0, 0, 0, 0, 0]), projection)
    assert Verifier(projection).motion(seen(wall, np.eye(4), projection).keyframe, far) is None


def test_a_keyframe_is_small_and_a_black_image_is_one_too(projection: StereoProjection) -> None:
    keyframe = seen(Wall(1), np.eye(4), projection).keyframe
    kept = (getattr(keyframe, name) for name in type(keyframe).__match_args__)
    assert sum(getattr(value, "nbytes", 0) for value in kept) + len(keyframe.patches) < 100_000
    black = np.zeros((240, 320), np.uint8)
    nothing = make_keyframe((black, black), projection, 0, 0, np.eye(4), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    wall = seen(Wall(1), np.eye(4), projection)
    assert Verifier(projection).motion(nothing, wall) is None
    assert Verifier(projection).motion(wall.keyframe, Seen(nothing, (black, black))) is None


def test_matches_are_mutual() -> None:
    rng = np.random.default_rng(0)
    a = rng.integers(0, 256, (50, 32), np.uint8)
    assert matches(a, a[::-1].copy()).tolist() == [[k, 49 - k] for k in range(50)]
    assert len(matches(a, np.repeat(a[:1], 5, axis=0))) == 0  # as near as the second: no match
    assert len(matches(a, a[:0])) == 0


def resected(lean_px: float, rng: np.random.Generator, projection: StereoProjection) -> tuple[PointViews, Resection]:
    """A motion by views of exact points with noise of STD_PX, of which upper ones are displaced along the row."""
    points = projection.triangulate(
        np.column_stack(
            [(u := rng.uniform(60, 300, 80)), (v := rng.uniform(20, 220, 80)), u - rng.uniform(5, 40, 80), v]
        )
    )
    z_px = projection.project(se3.transform(se3.inverse(SECOND), points)) + STD_PX * rng.normal(size=(80, 4))
    z_px[:, [0, 2]] += lean_px * (z_px[:, 1:2] < 120)
    views = PointViews(projection, points, None, z_px, np.broadcast_to(STD_PX**2 * np.eye(4), (80, 4, 4)))
    return views, resect(views, se3.inverse(SECOND))


def test_halves_of_the_views_differ_as_their_covariances_say_or_tell_of_errors_that_they_share(
    projection: StereoProjection,
) -> None:
    """One of three halves is the farthest, so a little more than one is expected; where parts err alike, much more."""
    rng = np.random.default_rng(0)
    sound = [_halves_apart(*resected(0.0, rng, projection)) for _ in range(60)]
    leaning = [_halves_apart(*resected(0.15, rng, projection)) for _ in range(20)]
    assert 1.0 < np.mean(sound) < 1.8
    assert min(leaning) > 2 * np.mean(sound)
