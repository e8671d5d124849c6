"""Slow views through which earlier images show: the smear is measured, reported, and over when its cause is over."""

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.frontend.patches import View
from stream_sfm.frontend.smear_check import SmearCheck
from tests.helpers.blends import beside_blended
from tests.helpers.places import DEMO
from tests.helpers.wall import blotches

_STEPS = 8  # moments of a shutter
_SIZE = (400, 300)
_REST = 3  # frames before the camera moves


def checked(
    share: float,
    speeds_px: np.ndarray,
    shutter: float = 0.0,
    std_grey: float = 1.0,
    seed: int = 0,
    std_px: float = 0.03,
) -> SmearCheck:
    """The check after a camera has moved past a wall at these speeds (n,); a `share` of each image is the one before.

    `shutter` is the part of a frame for which it is open.
    """
    rng, wall, check, shown = np.random.default_rng(seed), blotches(seed), SmearCheck(), None
    corners, at = rng.uniform((60, 60), (440, 340), (200, 2)), np.zeros(2)
    way = np.array((0.9, 0.44))
    for speed in speeds_px:
        opened = at + speed * (1 - shutter / 2) * way
        moments = (np.arange(_STEPS) + 0.5)[:, None] / _STEPS * shutter * speed * way + opened
        at = at + speed * way
        views = [np.float32([[1, 0, -x], [0, 1, -y]]) for x, y in moments]
        seen = [cv2.warpAffine(wall, view, _SIZE, flags=cv2.INTER_LANCZOS4) for view in views]
        new = np.mean(seen, axis=0) + std_grey * rng.normal(size=seen[0].shape)
        shown = new if shown is None else share * shown + (1 - share) * new
        image = cv2.GaussianBlur(np.rint(shown).clip(0, 255).astype(np.uint8), (0, 0), 1)
        px = corners - at
        rows = ((px > 0) & (px < _SIZE)).all(axis=1).nonzero()[0]
        check = check.after(View(image, rows, px[rows] + std_px * rng.normal(size=(len(rows), 2))))
    return check


def after_rest(speed_px: float, frames: int = 14) -> np.ndarray:
    return np.array([0.0] * _REST + [speed_px] * frames)


@pytest.mark.parametrize(("share", "speed_px"), [(0.2, 0.4), (0.2, 0.7), (0.3, 0.4), (0.3, 0.7), (0.5, 0.4)])
def test_the_smear_of_an_average_is_found_within_its_sigma(share: float, speed_px: float) -> None:
    """In frame n after the start of the motion, delays of 0 to n frames have the weights of a geometric series."""
    check = checked(share, after_rest(speed_px))
    expected = []
    for n in range(1, len(check.sums) + 1):
        delays = np.arange(n + 1)
        weights = (1 - share) * share**delays
        weights[-1] = share**n
        expected.append(weights @ delays**2 - (weights @ delays) ** 2)
    found, significance = check.share
    assert check.problem
    assert abs(found + 1 / 12 - np.mean(expected)) < 4 * found / significance + 0.1 * np.mean(expected)


@pytest.mark.parametrize("shutter", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(
    "speeds_px", [after_rest(0.5), after_rest(1.5), np.linspace(0.1, 1.5, 17), np.full(17, 2.0)]
)
def test_no_shutter_smears_by_as_much(shutter: float, speeds_px: np.ndarray) -> None:
    assert not any(checked(0, speeds_px, shutter, 2.0, seed).problem for seed in range(3))


@pytest.mark.parametrize("shutter", [0.0, 0.5, 1.0])
def test_the_smear_of_a_shutter_is_measured(shutter: float) -> None:
    """It is the rest after that of a whole frame is subtracted."""
    found, _ = checked(0, after_rest(1.5), shutter).share
    assert abs(found - (shutter**2 - 1) / 12) < 0.01


def test_a_camera_that_stands_still_is_not_judged() -> None:
    """If its tracks are uncertain, those that seem to move most have noise that looks like a smear."""
    assert not checked(0.3, np.zeros(12), std_px=0.1).sums
    assert checked(0.3, after_rest(0.4), std_px=0.1).sums


def test_a_suspicion_ends() -> None:
    check = checked(0.4, after_rest(0.6))
    assert check.problem
    assert check.last is not None
    for _ in range(150):  # the camera stands still
        check = check.after(check.last)
    assert not check.problem


@pytest.mark.parametrize("share", [0.0, 0.5, 0.65])
def test_tracks_that_follow_the_half_at_rest_are_found_in_the_first_frame(share: float) -> None:
    """The camera moves by 7 px and more past a wall with less contrast at the top; at rest none are found."""
    contrast = np.linspace(0.1, 1, 300)[:, None]
    for seed in range(3):
        rng, wall = np.random.default_rng(seed), blotches(seed)[60:360].astype(float)
        first, second = (128 + contrast * (wall[:, x : x + 400] - 128) for x in (60, 67 + 3 * seed))
        second = second if share else first
        first, second = (image + 4 * rng.normal(size=image.shape) for image in (first, second))
        shown = share * first + (1 - share) * second
        check, at = SmearCheck(), rng.uniform((20, 20), (380, 280), (120, 2))
        for image, px in ((first, at), (shown, at + rng.normal(0, 0.25, at.shape))):
            smoothed = cv2.GaussianBlur(np.rint(image).clip(0, 255).astype(np.uint8), (0, 0), 1)
            check = check.after(View(smoothed, np.arange(120), px))
        assert check.sums and bool(check.problem) == (share > 0)


def test_slow_frames_with_an_average_are_not_ok() -> None:
    """Points of the sample log move by a third of a pixel per frame at first."""
    for n, (sound, blended) in enumerate(beside_blended(DEMO, 0.5, 10)):
        assert n == 0 or sound.status is sfm.Status.OK
        if n > 2:
            assert blended.status is sfm.Status.DEGRADED
            assert "earlier images show through" in blended.reason
