"""Torn images: the upper or lower rows are those of the frame before."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.pictures.prepared import PreparedImages
from stream_sfm.pictures.rules import ImageRules
from stream_sfm.pictures.torn import copied, torn
from tests.helpers.estimators import nees
from tests.helpers.wall import Wall, camera_path, rig

SLOPE_GREY = ImageRules().slope_grey


def pair(pose: np.ndarray, noise: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    stereo, wall = rig(), Wall(2)
    right = pose @ se3.inverse(stereo.right_from_left)
    return wall.image(stereo.left, pose, noise), wall.image(stereo.right, right, noise)


def note(*frames: tuple[np.ndarray, np.ndarray]) -> str:
    """Of the last frame after these."""
    images = [PreparedImages.of(*frame, 0.8) for frame in frames]
    rows = [copied(now, before, SLOPE_GREY) for before, now in pairwise(images)]
    return torn(rows[-1], rows[-2])


FIRST, BEFORE, NOW = (
    pair(se3.exp([-0.03, 0, -0.02, 0, 0, 0])),
    pair(np.eye(4)),
    pair(se3.exp([0.03, 0, 0.02, 0, 0, 0])),
)


def spliced(upper: np.ndarray, lower: np.ndarray, row: int) -> np.ndarray:
    return np.concatenate([upper[:row], lower[row:]])


@pytest.mark.parametrize("row", [60, 101, 120, 170])
def test_rows_of_the_frame_before_are_found(row: int) -> None:
    upper = spliced(BEFORE[0], NOW[0], row), spliced(BEFORE[1], NOW[1], row)
    lower = spliced(NOW[0], BEFORE[0], row), spliced(NOW[1], BEFORE[1], row)
    assert "upper part of the left image" in note(FIRST, BEFORE, upper)
    assert "lower part of the left image" in note(FIRST, BEFORE, lower)
    assert "upper part of the right image" in note(FIRST, BEFORE, (NOW[0], upper[1]))
    bare = np.concatenate([upper[0][:row], np.full_like(NOW[0][row:], 90)])
    assert "upper part of the right image" in note(FIRST, BEFORE, (bare, upper[1]))


def test_whole_images_are_not_torn() -> None:
    assert note(FIRST, BEFORE, NOW) == ""
    assert note(FIRST, BEFORE, BEFORE) == ""  # frozen, which is another fault
    darker = tuple(np.rint(0.98 * image + 1).astype(np.uint8) for image in BEFORE)
    assert note(FIRST, BEFORE, darker) == ""
    first = copied(PreparedImages.of(*NOW, 0.8), None, SLOPE_GREY)
    assert torn(first, first) == ""


def test_a_camera_at_rest_before_which_something_moves_is_not_torn() -> None:
    """Images without noise are equal but for a body, which leaves parts of its rows as they were."""
    still = pair(np.eye(4), noise=0.0)
    other = pair(se3.exp([0.3, 0, 0, 0, 0, 0]), noise=0.0)
    moved = tuple(image.copy() for image in still)
    for image, of_body in zip(moved, other, strict=True):
        image[120:, 60:150] = of_body[120:, 60:150]
    assert note(other, still, moved) == ""


def test_a_bonnet_that_is_the_same_in_all_images_is_not_torn() -> None:
    """Simulators have no noise, so that a vehicle's own body is equal in all frames, also after a rest."""
    seen = [tuple(spliced(image, bonnet, 180) for image, bonnet in zip(f, NOW, strict=True)) for f in (FIRST, BEFORE)]
    assert note(*seen, seen[0]) == ""
    assert note(seen[0], seen[0], seen[1]) == ""


def test_rows_that_move_by_a_tenth_of_a_pixel_are_new() -> None:
    """Without noise most pixels stay as they are only where rows move by less than views err by."""
    moved = tuple(
        cv2.warpAffine(image, np.array([[1, 0, 0.1], [0, 1, 0.0]]), image.shape[::-1], flags=cv2.INTER_CUBIC)
        for image in BEFORE
    )
    torn_pair = spliced(BEFORE[0], moved[0], 120), spliced(BEFORE[1], moved[1], 120)
    assert "upper part of the left image" in note(FIRST, BEFORE, torn_pair)


@pytest.mark.parametrize("every", [4, 9])
def test_a_torn_frame_is_left_out_and_does_no_harm_later(every: int) -> None:
    """Two moments in one image would be two rigid motions, or one between them."""
    stereo, poses = rig(), camera_path(20)
    whole = list(Wall(2).frames(stereo, poses))
    frames, height = list(whole), len(whole[0].left)
    for k in range(every, len(frames), every):
        images = (spliced(getattr(whole[k - 1], of), getattr(whole[k], of), height // 2) for of in ("left", "right"))
        frames[k] = sfm.StereoFrame(whole[k].stamp_ns, *images)
    engine = sfm.Engine(stereo)
    estimates = [engine.step(frame) for frame in frames]
    for k, (e, pose) in enumerate(zip(estimates[1:], poses[1:], strict=True), 1):
        assert e.status is (sfm.Status.OK if k % every else sfm.Status.LOST), e.reason
        assert nees(e.world_from_cam, e.cov_pose, pose) < 22.5  # χ² of 6: 99.9 %
        assert bool(k % every) or "was it read while it was written" in e.reason
