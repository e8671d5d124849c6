"""Blur that grows lets points slide in both images alike, and σ of the slide says so, eq. (17c)."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from stream_sfm.frontend.learnt.sharpness import lost_or_gained
from tests.helpers.front_end import SteppedFrontEnd
from tests.helpers.wall import Wall, rig

FRAMES = 12
Seen = list[tuple[np.ndarray, np.ndarray, np.ndarray]]


def shown(change: Callable[[np.ndarray, int], np.ndarray]) -> Seen:
    """Ids, views (n, 4) and σ of slides (n,) of each frame of a camera at rest whose images `change` alters."""
    wall, front, seen = Wall(5), SteppedFrontEnd(rig()), []
    for k in range(FRAMES):
        frame = wall.frame(rig(), np.eye(4), k)
        observed = front.step(replace(frame, left=change(frame.left, k), right=change(frame.right, k)))
        assert observed.lasting.std_drift_px is not None
        seen.append((observed.track_ids, observed.z_px, observed.lasting.std_drift_px))
    return seen


def blurred(image: np.ndarray, k: int) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), 0.25 * k) if k else image


def test_points_slide_in_both_images_by_as_much_as_sigma_says() -> None:
    """All motion of a camera at rest is a slide; the tracks of the second frame that live to the end show it."""
    seen = shown(blurred)
    first, last = ({i: z for i, z in zip(*frame[:2], strict=True)} for frame in (seen[1], seen[-1]))
    both = [i for i in first if i in last]
    slid = np.array([last[i] - first[i] for i in both])
    slid = slid[np.isfinite(slid).all(axis=1)]
    claimed = np.sqrt(sum(np.median(std[std > 0]) ** 2 for _, _, std in seen[2:]))
    assert len(slid) > 40
    assert np.corrcoef(slid[:, 1], slid[:, 3])[0, 1] > 0.8  # rows do not show it
    rms = float(np.sqrt((slid**2).mean()))
    assert 0.5 * claimed < rms < 2.0 * claimed


@pytest.mark.parametrize(
    "change",
    [
        lambda image, k: image,
        lambda image, k: np.rint(image * 0.97 ** (k % 4)).astype(np.uint8),  # of brightness, and of contrast with it
    ],
    ids=["none", "exposure"],
)
def test_images_as_sharp_as_before_add_nothing(change: Callable[[np.ndarray, int], np.ndarray]) -> None:
    assert max(std.max() for _, _, std in shown(change)) < 0.005  # a σ of views is 0.04 px


def test_noise_and_motion_explain_small_changes() -> None:
    rng, before = np.random.default_rng(2), np.full(100, 0.8)
    noisy = [before * np.exp(0.02 * rng.normal(size=100)) for _ in range(300)]
    assert np.mean([lost_or_gained(before, now, 0.0).any() for now in noisy]) < 0.01
    assert not lost_or_gained(before, 1.05 * before, 0.03).any()
    assert lost_or_gained(before, 0.9 * before, 0.0) == pytest.approx(-np.log(0.9) / (0.9 * before))
    assert not lost_or_gained(np.full(100, np.nan), before, 0.0).any()
