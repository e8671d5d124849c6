"""Overlays on both images are reported while the scene moves, but never the static view of a standing camera."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.config.image_rules import StillRules
from stream_sfm.frontend.still_check import Lines, StillCheck
from tests.helpers.places import ROOM

TEXTURE = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (300, 900)).astype(np.uint8), (0, 0), 1.5)
TEXTURE = (128 + 3.0 * (TEXTURE.astype(float) - 128)).clip(0, 255).astype(np.uint8)


def scene(step: float, disparity: int) -> np.ndarray:
    return TEXTURE[:, 100 + int(step) + disparity : 500 + int(step) + disparity].copy()


def with_columns(image: np.ndarray) -> np.ndarray:
    image[:, 20::40] = 255
    return image


def as_it_is(image: np.ndarray) -> np.ndarray:
    return image


def checked(
    speed: float, disparity: int, drawn: Callable[[np.ndarray], np.ndarray], mask: np.ndarray | None = None
) -> StillCheck:
    check, rng = StillCheck(), np.random.default_rng(1)
    for n in range(6):
        left, right = (
            drawn((scene(speed * n, d) + rng.normal(0, 2, (300, 400))).clip(0, 255).astype(np.uint8))
            for d in (0, disparity)
        )
        check = check.after(Lines.of(left, check.rules, mask), Lines.of(right, check.rules, mask))
    return check


def test_columns_that_do_not_move_are_reported() -> None:
    assert "drawn over them" in checked(5, 12, with_columns).problem


@pytest.mark.parametrize(("speed", "disparity"), [(5, 12), (0, 12), (5, 0), (0, 0)])
def test_a_scene_is_not_reported(speed: float, disparity: int) -> None:
    """This holds for moving scenes, for a standing camera, and for scenes too far for disparity."""
    assert not checked(speed, disparity, as_it_is).problem


def test_a_distant_scene_is_not_reported_if_the_camera_hardly_turns() -> None:
    """Its edges are nearly where they were in the previous image, in both images, but not some frames earlier."""
    now, before = StillCheck(), StillCheck(rules=StillRules(apart_frames=1))
    for n in range(0, 24, now.rules.every):
        turned = cv2.warpAffine(TEXTURE, np.float32([[1, 0, -100 - 0.5 * n], [0, 1, 0]]), (400, 300))
        left, right = turned.copy(), turned.copy()
        left[100:], right[100:] = scene(5 * n, 0)[100:], scene(5 * n, 12)[100:]
        lines = Lines.of(left, now.rules), Lines.of(right, now.rules)
        now, before = now.after(*lines), before.after(*lines)
    assert before.problem and not now.problem


def test_masked_overlays_are_not_reported() -> None:
    mask = np.ones((300, 400), bool)
    for column in range(20, 400, 40):
        mask[:, column - 2 : column + 3] = False
    assert not checked(5, 12, with_columns, mask).problem


def test_frames_with_something_drawn_over_them_are_not_ok() -> None:
    engine = sfm.Engine((log := sfm.open_log(ROOM)).rig)
    for n, frame in enumerate(log.frames(sfm.Selection(max_frames=24))):
        left, right = (image.copy() for image in (frame.left, frame.right))
        if n < 8:
            left, right = with_columns(left), with_columns(right)
        estimate = engine.step(sfm.StereoFrame(frame.stamp_ns, left, right))
        if 3 < n < 8:  # before that the camera hardly moves
            assert "drawn over" in estimate.reason and estimate.status is sfm.Status.DEGRADED
    assert "drawn over" not in estimate.reason  # over when it is
