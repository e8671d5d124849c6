"""How far patches are taken to slide: by the part of the motion across the line of sight and by the one along it."""

import numpy as np
import pytest

from stream_sfm.frontend.noise import ViewNoise
from stream_sfm.geometry import se3

NOISE = ViewNoise.unknown(smoothing_px=1.0, radius_px=10)


def drift(ray: tuple[float, float], depth_m: float, motion_m: tuple[float, float, float]) -> float:
    """σ in px of one point, after a motion."""
    motion = se3.exp(np.array([0, 0, 0, 0.01, -0.02, 0.03]))
    motion[:3, 3] = motion_m
    return float(NOISE.drift(np.array([[*ray, 1.0, 1 / depth_m]]), motion)[0])


def test_drift_is_a_share_of_the_angle_and_turns_do_not_count():
    once = drift((0.0, 0.0), 2.0, (0.0, 0.0, 0.1))
    assert once == pytest.approx(2 * drift((0.0, 0.0), 4.0, (0.0, 0.0, 0.1)))
    assert once == pytest.approx(0.5 * drift((0.0, 0.0), 2.0, (0.0, 0.0, 0.2)))
    assert drift((0.0, 0.0), 2.0, (0.0, 0.0, 0.0)) == 0
    assert drift((0.0, 0.0), np.inf, (0.1, 0.0, 0.1)) == 0


def test_a_patch_that_comes_closer_slides_more_than_one_seen_from_the_side():
    along, across = drift((0.0, 0.0), 2.0, (0.0, 0.0, 0.1)), drift((0.0, 0.0), 2.0, (0.1, 0.0, 0.0))
    assert along > 1.5 * across > 0
    aslant = drift((1.0, 0.0), 2.0, (0.1, 0.0, 0.0))  # half along its ray, half across
    assert aslant**2 == pytest.approx((along**2 + across**2) / 2)


def test_motion_is_split_along_the_ray_of_each_point():
    rays = np.array([[0.6, 0.3], [-0.4, 0.5]])
    for ray in rays:
        line = np.append(ray, 1.0)
        toward = drift(tuple(ray), 3.0, tuple(0.1 * line / np.linalg.norm(line)))
        assert toward == pytest.approx(drift((0.0, 0.0), 3.0, (0.0, 0.0, 0.1)))
