"""Images through which earlier ones show, as by noise reduction over time: found, reported, and over with the cause."""

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.frontend.ghost_check import GhostCheck, View
from tests.helpers.blends import beside_blended
from tests.helpers.places import ROOM
from tests.helpers.wall import blotches

FRAMES = 12


def checked(
    share: float,
    std_grey: float = 2.0,
    pattern_grey: float = 0.0,
    accelerates: bool = True,
    seed: int = 0,
    speed: float = 1.0,
) -> GhostCheck:
    """The check after an accelerating camera has passed a wall; a `share` of each image is the one before."""
    rng, wall, check, shown = np.random.default_rng(seed), blotches(seed), GhostCheck(), None
    corners, at = rng.uniform((60, 60), (840, 640), (150, 2)), np.zeros(2)
    pattern = pattern_grey * rng.normal(size=(300, 400))
    for n in range(FRAMES):
        at = at + speed * np.array((5 + 1.5 * n, 0.7 * n) if accelerates else (9, 2))
        moved = cv2.warpAffine(wall, np.float32([[1, 0, -at[0]], [0, 1, -at[1]]]), (400, 300))
        new = moved + pattern + std_grey * rng.normal(size=moved.shape)
        shown = new if shown is None else share * shown + (1 - share) * new
        image = cv2.GaussianBlur(np.rint(shown).clip(0, 255).astype(np.uint8), (0, 0), 1)
        px = corners - at
        rows = ((px > 0) & (px < (400, 300))).all(axis=1).nonzero()[0]
        check = check.after(View(image, rows, px[rows] + 0.05 * rng.normal(size=(len(rows), 2))))
    return check


@pytest.mark.parametrize("share", [0.15, 0.3, 0.5])
def test_a_ghost_is_found(share: float) -> None:
    check = checked(share)
    assert "earlier images show through" in check.problem
    assert 0.2 * share < check.share[0] < 1.1 * share  # less than all: reference patches have ghosts, too


@pytest.mark.parametrize("accelerates", [True, False])
def test_without_a_ghost_the_share_is_zero_within_its_sigma(accelerates: bool) -> None:
    """Noise, and a pattern of the sensor that stays at its pixels, are no ghosts."""
    found = np.array([checked(0, 4.0, 2.0, accelerates, seed).share for seed in range(8)])
    assert np.abs(found[:, 0]).max() < 0.01
    assert np.abs(found[:, 1]).max() < 4
    assert not any(checked(0, 4.0, 2.0, accelerates, seed).problem for seed in range(8))


@pytest.mark.parametrize("pattern_grey", [4.0, 8.0])
def test_a_strong_pattern_of_the_sensor_is_no_ghost_if_the_view_moves_slowly(pattern_grey: float) -> None:
    """It is in both images at the same pixels, but the same in both directions of time."""
    found = [
        checked(0, 2.0, pattern_grey, accelerates, seed, 0.25) for accelerates in (True, False) for seed in (0, 1)
    ]
    assert max(check.share[1] for check in found) < 4
    assert not any(check.problem for check in found)


def test_a_suspicion_ends() -> None:
    check = checked(0.4)
    for _ in range(150):  # the camera stands still
        check = check.after(check.views[-1])
    assert not check.problem


def test_frames_with_a_ghost_are_not_ok() -> None:
    """No frame of a log with noise reduction of 0.3 is ok; without it all are."""
    for n, (sound, blended) in enumerate(beside_blended(ROOM, 0.3, 16)):
        if n > 0:
            assert sound.status is sfm.Status.OK
            assert blended.status is sfm.Status.DEGRADED
            assert "earlier images show through" in blended.reason
