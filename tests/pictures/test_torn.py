"""Torn images: the upper or lower rows are those of the frame before."""

import numpy as np
import pytest

from stream_sfm.geometry import se3
from stream_sfm.pictures.prepared import PreparedImages
from stream_sfm.pictures.rules import ImageRules
from stream_sfm.pictures.torn import torn
from tests.helpers.wall import Wall, rig

SLOPE_GREY = ImageRules().slope_grey


def pair(pose: np.ndarray, noise: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    stereo, wall = rig(), Wall(2)
    right = pose @ se3.inverse(stereo.right_from_left)
    return wall.image(stereo.left, pose, noise), wall.image(stereo.right, right, noise)


def note(now: tuple[np.ndarray, np.ndarray], before: tuple[np.ndarray, np.ndarray]) -> str:
    return torn(PreparedImages.of(*now, 0.8), PreparedImages.of(*before, 0.8), SLOPE_GREY)


BEFORE, NOW = pair(np.eye(4)), pair(se3.exp([0.03, 0, 0.02, 0, 0, 0]))


def spliced(upper: np.ndarray, lower: np.ndarray, row: int) -> np.ndarray:
    return np.concatenate([upper[:row], lower[row:]])


@pytest.mark.parametrize("row", [60, 101, 120, 170])
def test_rows_of_the_frame_before_are_found(row: int) -> None:
    upper = spliced(BEFORE[0], NOW[0], row), spliced(BEFORE[1], NOW[1], row)
    lower = spliced(NOW[0], BEFORE[0], row), spliced(NOW[1], BEFORE[1], row)
    assert "upper part of the left image" in note(upper, BEFORE)
    assert "lower part of the left image" in note(lower, BEFORE)
    assert "upper part of the right image" in note((NOW[0], upper[1]), BEFORE)


def test_whole_images_are_not_torn() -> None:
    assert note(NOW, BEFORE) == ""
    assert note(BEFORE, BEFORE) == ""  # frozen, which is another fault
    assert note(tuple(np.rint(0.98 * image + 1).astype(np.uint8) for image in BEFORE), BEFORE) == ""
    assert torn(PreparedImages.of(*NOW, 0.8), None, SLOPE_GREY) == ""


def test_a_camera_at_rest_before_which_something_moves_is_not_torn() -> None:
    """Images without noise are equal but for a body, which leaves parts of its rows as they were."""
    still = pair(np.eye(4), noise=0.0)
    other = pair(se3.exp([0.3, 0, 0, 0, 0, 0]), noise=0.0)
    moved = tuple(image.copy() for image in still)
    for image, of_body in zip(moved, other, strict=True):
        image[120:, 60:150] = of_body[120:, 60:150]
    assert note(moved, still) == ""
