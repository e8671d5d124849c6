"""A picture that is laid over both images, such as a time stamp, shows no scene, and does not hold the camera."""

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.camera.rectification import Rectifier
from stream_sfm.config import Config
from stream_sfm.frontend.second_motions.overlays import are_laid_over, overlays
from stream_sfm.frontend.state import Setup
from stream_sfm.geometry import se3
from stream_sfm.record import changed
from tests.helpers.tracks import tracks_at
from tests.helpers.wall import Wall, rig

VERGENCE_RAD, N = 0.05, 12
STEREO = rig(VERGENCE_RAD)
HORIZON_M = 0.2 / VERGENCE_RAD  # where a point is at the same pixels of both images


def setup(vergence_rad: float) -> Setup:
    rectifier = Rectifier(rig(vergence_rad))
    return Setup(rectifier.projection, Config(), raw_shifts_px=rectifier.raw_shifts_px)


def with_picture(frame: sfm.StereoFrame, share: float) -> sfm.StereoFrame:
    """The frame with grains of a picture over a `share` of the view, the same in both images."""
    height, width = frame.left.shape
    grains = np.random.default_rng(3).integers(0, 2, (height // 6, width // 6))
    picture, first = np.kron(grains, np.full((6, 6), 200)).astype(np.uint8) + 20, round(height * (1 - share))
    images = [image.copy() for image in (frame.left, frame.right)]
    for image in images:
        image[first : len(picture), : picture.shape[1]] = picture[first:]
    return sfm.StereoFrame(frame.stamp_ns, *images)


def estimates(share: float) -> list[sfm.FrameEstimate]:
    """The estimates while the camera moves to the side by 15 mm per frame."""
    engine, wall = sfm.Engine(STEREO), Wall(2)
    poses = [se3.exp([0.015 * k, 0, 0, 0, 0, 0]) for k in range(N)]
    return [engine.step(with_picture(wall.frame(STEREO, pose, k), share)) for k, pose in enumerate(poses)]


def test_a_point_at_the_same_pixels_of_both_images_is_laid_over() -> None:
    depth_m = np.array([HORIZON_M, 0.5 * HORIZON_M, 2 * HORIZON_M, 1e9])
    points = tracks_at(depth_m).points * (0, 0, 1, 1)  # straight ahead
    verged = setup(VERGENCE_RAD)
    assert are_laid_over(verged, points).tolist() == [True, False, False, False]
    assert not are_laid_over(setup(0.0), points).any()  # of parallel cameras, far points are at the same pixels
    assert not are_laid_over(Setup(verged.projection, Config()), points).any()


@pytest.mark.parametrize(
    ("n_on_picture", "scene_moves_px", "found"),
    [
        (20, 2.0, True),
        (20, 0.1, False),
        (5, 2.0, False),
    ],  # a camera at rest shows nothing; a few points may be chance
)
def test_points_on_a_picture_are_found_while_most_others_move(
    n_on_picture: int, scene_moves_px: float, found: bool
) -> None:
    of_picture = np.arange(n_on_picture + 30) < n_on_picture
    tracks = tracks_at(np.where(of_picture, HORIZON_M, 2.0))
    tracks = changed(tracks, points=tracks.points * (0, 0, 1, 1))
    now_px = tracks.left_px + np.where(of_picture, 0.05, scene_moves_px)[:, None] * (1, 0)
    assert overlays(setup(VERGENCE_RAD), tracks, now_px).tolist() == (of_picture & found).tolist()


def test_a_picture_over_half_of_the_view_does_not_hold_the_camera() -> None:
    for k, estimate in enumerate(estimates(0.5)[1:], 1):
        assert np.linalg.norm(estimate.world_from_cam[:3, 3] - (0.015 * k, 0, 0)) < 0.01
        assert estimate.status is sfm.Status.OK


def test_a_picture_over_all_of_the_view_is_named() -> None:
    found = estimates(1.0)[1:]
    assert all(e.status is not sfm.Status.OK for e in found)
    assert any("a picture laid over the images" in e.reason for e in found)
