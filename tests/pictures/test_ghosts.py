"""Images through which earlier ones show, as by noise reduction over time: found, reported, and over with the cause."""

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.config.rules import Rules
from stream_sfm.pictures.checks import Suspicions
from stream_sfm.pictures.prepared import PreparedImages
from tests.helpers.blends import beside_blended
from tests.helpers.places import DEMO, ROOM
from tests.helpers.wall import blotches

FRAMES = 12


def passed(
    share: float,
    std_grey: float = 2.0,
    pattern_grey: float = 0.0,
    accelerates: bool = True,
    seed: int = 0,
    speed: float = 1.0,
) -> Suspicions:
    """The state after an accelerating camera has passed a wall; a `share` of each image is the one before."""
    rng, wall, state, shown = np.random.default_rng(seed), blotches(seed), Suspicions.begun(Rules()), None
    corners, at = rng.uniform((60, 60), (840, 640), (150, 2)), np.zeros(2)
    pattern = pattern_grey * rng.normal(size=(300, 400))
    for n in range(FRAMES):
        at = at + speed * np.array((5 + 1.5 * n, 0.7 * n) if accelerates else (9, 2))
        moved = cv2.warpAffine(wall, np.float32([[1, 0, -at[0]], [0, 1, -at[1]]]), (400, 300))
        new = moved + pattern + std_grey * rng.normal(size=moved.shape)
        shown = new if shown is None else share * shown + (1 - share) * new
        image = np.rint(shown).clip(0, 255).astype(np.uint8)
        px = corners - at
        rows = ((px > 0) & (px < (400, 300))).all(axis=1).nonzero()[0]
        images = PreparedImages.of(image, image, 1.0)
        state = state.after(images, rows, px[rows] + 0.05 * rng.normal(size=(len(rows), 2)))
    return state


@pytest.mark.parametrize("share", [0.15, 0.3, 0.5])
def test_a_ghost_is_found(share: float) -> None:
    assert "earlier images show through" in passed(share).problem


@pytest.mark.parametrize("accelerates", [True, False])
def test_without_a_ghost_no_frame_has_evidence_of_one(accelerates: bool) -> None:
    """Noise, and a pattern of the sensor that stays at its pixels, are no ghosts."""
    for seed in range(8):
        state = passed(0, 4.0, 2.0, accelerates, seed)
        assert not state.problem and state.each[0].evidence.change < 3 and state.each[0].looks == FRAMES - 1


@pytest.mark.parametrize("pattern_grey", [4.0, 8.0])
def test_a_strong_pattern_of_the_sensor_is_no_ghost_if_the_view_moves_slowly(pattern_grey: float) -> None:
    """It is in both images at the same pixels, but the same in both directions of time."""
    for accelerates in (True, False):
        for seed in (0, 1):
            assert not passed(0, 2.0, pattern_grey, accelerates, seed, 0.25).problem


@pytest.mark.parametrize(("share", "first"), [(0.6, 5), (0.85, 11)])
def test_a_start_that_is_too_slow_for_two_frames_is_compared_with_an_earlier_one(share: float, first: int) -> None:
    """The demo starts with 0.2 to 0.5 px per frame; in two frames enough patches move by 1.5 px from the 16th on."""
    for n, (sound, blended) in enumerate(beside_blended(DEMO, share, 16)):
        if n >= first:
            assert sound.status is sfm.Status.OK
            assert "earlier images show through" in blended.reason


def test_frames_with_a_ghost_are_not_ok() -> None:
    """With noise reduction of 0.3 the second moving frame tells; without it all frames are ok."""
    for n, (sound, blended) in enumerate(beside_blended(ROOM, 0.3, 16)):
        if n > 0:
            assert sound.status is sfm.Status.OK
            assert blended.status is sfm.Status.DEGRADED
            assert "earlier images show through" in blended.reason
