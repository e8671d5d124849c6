"""Row differences that a calibration leaves are learnt from matches, wrong ones among them."""

import numpy as np
import pytest

from stream_sfm.frontend.vertical_disparity import VerticalDisparity
from stream_sfm.geometry.stereo import StereoProjection

P = StereoProjection(600.0, 320.0, 320.0, 240.0, 0.2, 640, 480)


def matches(rng: np.random.Generator, n: int, wrong: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    left = rng.uniform((0, 0), (639, 479), (n, 2))
    x, y = ((left - (319.5, 239.5)) / 319.5).T
    truth = 0.3 - 0.2 * x + 0.1 * y - 0.5 * x * y
    seen = truth + 0.1 * rng.standard_normal(n)
    bad = rng.random(n) < wrong
    seen[bad] += rng.uniform(-5, 5, int(bad.sum()))
    return left, truth, seen


@pytest.mark.parametrize("wrong", [0.0, 0.2])
def test_smooth_differences_are_learnt(wrong: float) -> None:
    rng = np.random.default_rng(1)
    rows = VerticalDisparity(P, max_px=1.5)
    for _ in range(20):
        left, _, seen = matches(rng, 40, wrong)
        rows.learn(left, seen)
    left, truth, _ = matches(rng, 500, 0.0)
    # six coefficients from 800 matches of 0.1 px: 0.1 √(6/800) on average, twice that in the corners; and the share of
    # wrong matches that no robust weight tells from good ones
    assert np.abs(rows.at(left) - truth).max() < 5 * 0.1 * np.sqrt(6 / 800)
    assert 4 * 0.1 * 0.8 < rows.gate_px < 4 * 0.1 * 1.6


def test_nothing_is_claimed_before_anything_is_seen() -> None:
    rows = VerticalDisparity(P, max_px=1.5)
    assert (rows.at(np.array([[0.0, 0.0], [639.0, 479.0]])) == 0).all()
    rows.learn(np.zeros((3, 2)), np.ones(3))  # too few to tell a surface from noise
    assert (rows.at(np.zeros((1, 2))) == 0).all()
