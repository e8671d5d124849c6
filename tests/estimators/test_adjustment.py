"""Jacobians against differences; covariances and their transport against Monte Carlo."""

import numpy as np
import pytest

from stream_sfm.estimators.baselines.bundle_adjustment import residuals_and_jacobians
from stream_sfm.estimators.baselines.full_batch import gather_views
from stream_sfm.estimators.triangulation import compose_cov, points_to_world, triangulate
from stream_sfm.geometry import se3
from stream_sfm.simulation.scenes import rectified_projection

P = rectified_projection()
RNG = np.random.default_rng(3)


def numerical(function, n, step=1e-6):
    """∂function(δ)/∂δ at 0, central differences; δ of n numbers."""
    e = step * np.eye(n)
    return np.stack([(function(e[k]) - function(-e[k])) / (2 * step) for k in range(n)], axis=-1)


def test_jacobians_are_differences(arc):
    ids, views = gather_views(arc.observations)
    poses, points = arc.world_from_cam, arc.points_in_world[ids]
    _, j_pose, j_point = residuals_and_jacobians(P, poses, points, views)

    def predicted(poses, points):
        return -residuals_and_jacobians(P, poses, points, views)[0]

    assert j_pose == pytest.approx(numerical(lambda d: predicted(poses @ se3.exp(d), points), 6), abs=1e-4)
    assert j_point == pytest.approx(numerical(lambda d: predicted(poses, points + d), 3), abs=1e-4)


def test_point_in_source_jacobian_is_differences():
    pose, point = se3.exp(RNG.normal(size=6)), RNG.normal(size=(5, 3))
    in_cam = se3.transform(se3.inverse(pose), point)
    expected = numerical(lambda d: se3.transform(se3.inverse(pose @ se3.exp(d)), point), 6)
    assert se3.point_in_source_jacobian(in_cam) == pytest.approx(expected, abs=1e-8)


def sample_cov(samples):
    d = samples - samples.mean(axis=0)
    return np.einsum("k...i,k...j->...ij", d, d) / (len(samples) - 1)


def assert_same_covariance(measured, expected, tolerance):
    """Whether it is within `tolerance` in the metric of the expected one."""
    root = np.linalg.inv(np.linalg.cholesky(expected))
    whitened = root @ measured @ np.swapaxes(root, -1, -2)
    assert np.abs(whitened - np.eye(expected.shape[-1])).max() < tolerance


def test_composition_is_monte_carlo():
    a, b = se3.exp(RNG.normal(size=6)), se3.exp(RNG.normal(size=6))
    roots = 1e-3 * RNG.normal(size=(2, 6, 6))
    xi = roots @ RNG.normal(size=(40_000, 2, 6, 1))
    product = a @ se3.exp(xi[:, 0, :, 0]) @ b @ se3.exp(xi[:, 1, :, 0])
    measured = sample_cov(se3.log(se3.inverse(a @ b) @ product))
    expected = compose_cov(roots[0] @ roots[0].T, b, roots[1] @ roots[1].T)
    assert_same_covariance(measured, expected, 0.06)


def test_points_to_world_is_monte_carlo():
    pose, point = se3.exp(RNG.normal(size=6)), RNG.normal(size=(1, 3))
    root, point_root = 1e-3 * RNG.normal(size=(6, 6)), 1e-3 * RNG.normal(size=(3, 3))
    n = 40_000
    poses = pose @ se3.exp(RNG.normal(size=(n, 6)) @ root.T)
    moved = point + RNG.normal(size=(n, 3)) @ point_root.T
    measured = sample_cov(se3.transform(poses, moved[:, None])[:, 0])
    _, expected = points_to_world(pose, root @ root.T, point, (point_root @ point_root.T)[None])
    assert_same_covariance(measured, expected[0], 0.06)


def test_triangulation_is_monte_carlo():
    exact = np.array([0.3, -0.2, 2.4])
    cov = np.diag([0.1, 0.2, 0.1, 0.15])
    z = P.project(exact) + RNG.normal(size=(40_000, 4)) @ np.sqrt(cov)
    points, cov_points = triangulate(P, z, np.broadcast_to(cov, (len(z), 4, 4)))
    assert_same_covariance(sample_cov(points), triangulate(P, P.project(exact)[None], cov[None])[1][0], 0.08)
    assert cov_points.shape == (len(z), 3, 3)
