"""Motion and depths with one camera, from two views and from parallax."""

import numpy as np
import pytest

from stream_sfm.frontend.mono.parallax import depths_from_motion
from stream_sfm.frontend.mono.two_view import MonoRules, two_view_motion
from stream_sfm.geometry import se3

STD = 3e-4  # 0.2 px at f = 600


def views(rng, now_from_first, count=150, noise=STD):
    """Rays of points 8 to 20 units away, in both views."""
    rays = rng.uniform(-0.4, 0.4, (count, 2))
    rho = rng.uniform(1 / 20, 1 / 8, count)
    points = np.column_stack([rays, np.ones(count), rho]) @ now_from_first.T
    now = points[:, :2] / points[:, 2:3]
    return rays + rng.normal(scale=noise, size=rays.shape), now + rng.normal(scale=noise, size=rays.shape), rho


@pytest.mark.parametrize("direction", [(1, 0.2, 0.1), (0.1, 0, -1)])
def test_motion_and_depths_are_found_with_consistent_covariances(direction) -> None:
    """Mean NEES over 60 draws: five degrees of freedom of the motion, one of a depth once the motion is given."""
    rng = np.random.default_rng(0)
    true = se3.exp([0, 0, 0, 0.05, -0.08, 0.1])
    true[:3, 3] = np.array(direction) / np.linalg.norm(direction)
    nees, depth = [], []
    for _ in range(60):
        first, now, rho = views(rng, true)
        found = two_view_motion(first, now, STD, MonoRules())
        assert found is not None and found.agree.mean() > 0.97 and not found.problem
        assert np.linalg.norm(found.now_from_first[:3, 3]) == pytest.approx(1)
        xi = se3.log(found.now_from_first @ se3.inverse(true))  # truth⁻¹ = estimate⁻¹ Exp(ξ)
        nees.append(xi @ np.linalg.solve(found.cov_first_from_now, xi))
        exact, variance = depths_from_motion(true, first, now, 2 * STD**2 * np.eye(2))
        depth.append(np.mean((exact - rho) ** 2 / variance))
    assert 3.5 < np.mean(nees) < 6.5
    assert 0.9 < np.mean(depth) < 1.1


def test_rays_of_something_else_are_recognised() -> None:
    rng = np.random.default_rng(1)
    true = se3.exp([1.0, 0, 0, 0, 0.05, 0])
    first, now, _ = views(rng, true)
    now[:30] += rng.uniform(0.02, 0.1, (30, 2)) * rng.choice([-1, 1], (30, 2))
    found = two_view_motion(first, now, STD, MonoRules())
    assert found is not None and not found.problem
    assert found.agree[30:].mean() > 0.97 and found.agree[:30].mean() < 0.3
    assert np.linalg.norm(se3.log(found.now_from_first @ se3.inverse(true))) < 0.1


@pytest.mark.parametrize("turn", [(0, 0, 0), (0.02, -0.1, 0.05)])
def test_without_a_baseline_no_depth_is_estimated(turn) -> None:
    rng = np.random.default_rng(2)
    first, now, _ = views(rng, se3.exp([0, 0, 0, *turn]))
    found = two_view_motion(first, now, STD, MonoRules())
    assert found is None or found.problem
    assert found is None or np.allclose(se3.log_so3(found.now_from_first[:3, :3]), turn, atol=3e-3)


def test_too_few_rays_give_no_motion() -> None:
    first, now, _ = views(np.random.default_rng(3), se3.exp([1, 0, 0, 0, 0, 0]), count=7)
    assert two_view_motion(first, now, STD, MonoRules()) is None
