"""Local structure against depth: a slanted plane, a depth edge, true and false covariances."""

from types import SimpleNamespace

import numpy as np
import pytest

from stream_sfm.camera.models import Camera
from stream_sfm.evaluation.structure import StructureComparison, structure_errors

CAMERA = Camera(320, 240, np.array([[300.0, 0, 160.5], [0, 310.0, 118.2], [0, 0, 1]]))
NORMAL, OFFSET = np.array([0.3, -0.2, 1.0]), 3.0  # the plane n·p = 3 m


def plane_depth() -> np.ndarray:
    u, v = np.meshgrid(np.arange(320), np.arange(240))
    rays = np.stack([(u - 160.5) / 300, (v - 118.2) / 310, np.ones(u.shape)], axis=-1)
    return OFFSET / (rays @ NORMAL)


def plane_points(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rays = np.column_stack([rng.uniform(-0.45, 0.45, n), rng.uniform(-0.33, 0.33, n), np.ones(n)])
    return rays * (OFFSET / (rays @ NORMAL))[:, None]


def test_errors_drawn_from_the_covariance_have_the_estimated_sigma_and_exact_points_none():
    rng = np.random.default_rng(1)
    points = plane_points(4000)
    half = np.diag([0.004, 0.003, 0.02])
    half[2, 0] = 0.01
    cov = np.tile(half @ half.T, (4000, 1, 1))
    exact = structure_errors(CAMERA, points, cov, plane_depth())
    assert len(exact.errors_m) == 4000 and abs(exact.errors_m).max() < 1e-9  # rounding: the fit of a plane is exact
    found = structure_errors(CAMERA, points + rng.normal(size=(4000, 3)) @ half.T, cov, plane_depth())
    ratio = np.sqrt(np.mean((found.errors_m / found.sigmas_m) ** 2))
    assert ratio == pytest.approx(1, abs=4 / np.sqrt(2 * 4000))  # four standard errors


def test_points_at_a_depth_edge_or_off_the_image_or_without_depth_are_left_out():
    depth = plane_depth()
    depth[:, 160:] += 1.0
    depth[100:, :50] = np.nan
    at_edge = np.array([[-0.0, 0.0, 3.0]])
    outside = np.array([[-3.0, 0.0, 3.0], [0.0, 0.0, -1.0]])
    unknown = np.array([[-1.3, 0.3, 3.0]])
    points = np.concatenate([at_edge, outside, unknown])
    found = structure_errors(CAMERA, points, np.tile(np.eye(3), (len(points), 1, 1)), depth)
    assert len(found.errors_m) == 0


def estimate(points: np.ndarray, cov: np.ndarray) -> SimpleNamespace:
    """What is compared of the estimate of a frame at the origin."""
    return SimpleNamespace(
        stamp_ns=0, track_ids=np.arange(len(points)), points_in_cam=points, cov_points=cov, points_in_world=points,
        cov_points_in_world=cov,
    )  # fmt: skip


def test_a_comparison_sums_the_frames_that_have_a_depth_image():
    points = plane_points(50)
    cov = np.tile(1e-4 * np.eye(3), (50, 1, 1))
    comparison = StructureComparison(CAMERA)
    assert all(np.isnan(figure) for figure in comparison.figures().values())
    near, far = (estimate(scale * points, cov) for scale in (1.01, 2.0))
    assert comparison.add(far, None) is None
    assert comparison.add(far, plane_depth()[:-1]) is None
    assert comparison.add(near, plane_depth()) is not None
    figures, errors_m = comparison.figures(), 0.01 * points[:, 2]
    assert figures["local_structure_rms_m"] == pytest.approx(np.sqrt(np.mean(errors_m**2)), rel=1e-6)
    assert figures["local_structure_median_m"] == pytest.approx(np.median(errors_m), rel=1e-6)  # float32


def test_median_and_tail_say_whether_few_points_decide_the_rms():
    points = plane_points(2000)
    noise = np.random.default_rng(2).normal(scale=0.01, size=len(points))
    noise[:4] = 5.0  # beside an occluding edge
    rays = points / points[:, 2:]
    moved = estimate(points + noise[:, None] * rays, _along(rays, 0.01))
    comparison = StructureComparison(CAMERA)
    comparison.add(moved, plane_depth())
    figures = comparison.figures()
    assert figures["local_structure_error_over_sigma"] > 10  # 500 σ of 4 in 2000: 22
    std = 0.5 / (0.6355 * np.sqrt(len(points)))  # of a median, by the density there
    median = figures["local_structure_error_over_sigma_median"]
    assert median == pytest.approx(0.6745, abs=4 * std)
    expected = 100 * (4 / len(points) + 0.0027)
    tolerance = 400 * np.sqrt(0.0027 / len(points))  # four standard errors
    assert figures["local_structure_beyond_3_sigma_percent"] == pytest.approx(expected, abs=tolerance)


def _along(rays: np.ndarray, sigma_m: float) -> np.ndarray:
    """Covariances of points that err along their rays only."""
    return sigma_m**2 * rays[:, :, None] * rays[:, None, :]
