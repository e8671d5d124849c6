"""The robot's own arm is in view from the first frame on: it stands still in the images, but is not the scene."""

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.config import Config
from stream_sfm.frontend.second_motions.depth_order import is_behind
from stream_sfm.frontend.state import Setup
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from tests.helpers.estimators import nees
from tests.helpers.tracks import tracks_at
from tests.helpers.wall import Wall, camera_path, rig

N, DISPARITY_PX = 20, 65  # 0.8 m away, in front of a wall at 3 m


def with_arm(frame: sfm.StereoFrame, share: float, seed: int) -> sfm.StereoFrame:
    """The frame with an arm that covers a `share` of the view, from its lower border up."""
    height, width = frame.left.shape
    grain = np.random.default_rng(1).normal(size=(height, width + DISPARITY_PX)).astype(np.float32)
    blotches = cv2.GaussianBlur(grain, (0, 0), 2.5)
    arm = 120 + 40 * blotches / blotches.std()
    noise, first = np.random.default_rng(seed), round(height * (1 - share))
    images = []
    for image, shift in ((frame.left, 0), (frame.right, DISPARITY_PX)):
        seen = image.astype(float)
        seen[first:] = arm[first:, shift : shift + width] + noise.normal(size=(height - first, width))
        images.append(np.clip(np.rint(seen), 0, 255).astype(np.uint8))
    return sfm.StereoFrame(frame.stamp_ns, *images)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
def test_an_arm_in_front_of_the_scene_is_not_taken_for_it(share: float) -> None:
    stereo, poses = rig(), camera_path(N)
    engine = sfm.Engine(stereo)
    frames = [with_arm(frame, share, n) if share else frame for n, frame in enumerate(Wall().frames(stereo, poses))]
    estimates = [engine.step(frame) for frame in frames]
    assert nees(estimates[-1].world_from_cam, estimates[-1].cov_pose, poses[-1]) < 22.5  # χ² of 6: 99.9 %
    begin, end = (estimates[k].world_from_cam for k in (N // 2, N - 1))
    lately = se3.inverse(se3.inverse(begin) @ end) @ se3.inverse(poses[N // 2]) @ poses[-1]
    assert np.linalg.norm(lately[:3, 3]) < 0.01  # 0.23 m would be the error if the arm were followed
    assert estimates[-1].status is sfm.Status.OK


def test_a_floor_in_front_of_the_camera_does_not_hide_that_a_body_is_in_front_of_the_scene() -> None:
    """The floor is nearer than the body, but far from it in the image; the wall surrounds the body."""
    u, v = (x.ravel() for x in np.meshgrid(np.arange(10.0, 320, 20), np.arange(10.0, 240, 20)))
    on_body = (abs(u - 160) < 50) & (v > 60) & (v < 150)
    depth_m = np.where(on_body, 2.0, np.where(v > 180, 1.0, 4.0))
    tracks = tracks_at(depth_m, left_px=np.stack([u, v], axis=1))
    body, scene = tracks.keep(on_body), tracks.keep(~on_body)
    setup = Setup(StereoProjection(400.0, 160.0, 160.0, 120.0, 0.1, 320, 240), Config())
    assert is_behind(setup, scene, body)
    assert not is_behind(setup, body, scene)
