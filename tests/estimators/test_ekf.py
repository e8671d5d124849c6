"""The filterpy filter against a textbook update written from scratch."""

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators.baselines.ekf import Ekf
from stream_sfm.geometry import se3


def numerical_measurement_jacobian(projection, pose, points, step=1e-6):
    """H by differences over ξ of the pose, then each point's coordinates."""

    def views(state):
        moved = pose @ se3.exp(state[:6])
        return projection.project(se3.transform(se3.inverse(moved), points + state[6:].reshape(-1, 3))).ravel()

    e = step * np.eye(6 + points.size)
    return np.stack([(views(d) - views(-d)) / (2 * step) for d in e], axis=1)


def test_update_is_the_textbook_one(arc):
    """One frame in information form, (P⁻¹ + HᵀR⁻¹H)⁻¹, with H from differences and no filterpy."""
    ekf = Ekf(arc.projection, Config())
    for o in arc.observations[:3]:
        ekf.step(o)
    o = arc.observations[3]
    ekf._drop(np.isin(ekf._ids, o.track_ids))
    rows = np.searchsorted(o.track_ids, ekf._ids)
    z, cov = o.z_px[rows], o.cov_px[rows]
    lin_pose = ekf._world_from_cam = arc.world_from_cam[3] @ se3.exp([1e-3, 2e-3, -1e-3, 1e-3, -1e-3, 2e-3])
    points, prior = ekf._points.copy(), ekf._cov.copy()

    h = numerical_measurement_jacobian(arc.projection, lin_pose, points)
    r = (z - arc.projection.project(se3.transform(se3.inverse(lin_pose), points))).ravel()
    weight = np.zeros((len(z), 4, len(z), 4))
    weight[np.arange(len(z)), :, np.arange(len(z)), :] = np.linalg.inv(cov)
    weight = weight.reshape(4 * len(z), -1)
    information = h.T @ weight @ h
    free = np.diag([1e-2, 1e-2, 1e-2, 1e-3, 1e-3, 1e-3])
    information[:6, :6] += np.linalg.inv(free)
    information[6:, 6:] += np.linalg.inv(prior[6:, 6:])
    posterior = np.linalg.inv(information)
    delta = posterior @ h.T @ weight @ r

    ekf._update(z, cov, np.ones(len(z), bool), free)
    # H by differences is good to 1e-8 of itself
    assert se3.log(se3.inverse(lin_pose) @ ekf._world_from_cam) == pytest.approx(delta[:6], abs=1e-8)
    assert ekf._points - points == pytest.approx(delta[6:].reshape(-1, 3), abs=1e-8)
    scale = np.sqrt(np.diag(posterior))
    assert np.abs((ekf._cov - posterior) / np.outer(scale, scale)).max() < 1e-5


def test_new_points_are_correlated_with_the_pose(arc):
    """The joint covariance of pose and new points is that of X = T ⊞ ξ applied to X_c + δ, by differences."""
    ekf = Ekf(arc.projection, Config())
    for o in arc.observations[:2]:
        ekf.step(o)
    ekf._drop(np.zeros(len(ekf._ids), bool))
    o = arc.observations[2]
    ekf._add(o)
    pose, cov_pose = ekf._world_from_cam, ekf._cov[:6, :6]
    in_cam = se3.transform(se3.inverse(pose), ekf._points)
    e = 1e-6 * np.eye(6)
    g = np.stack(
        [
            ((se3.transform(pose @ se3.exp(d), in_cam) - se3.transform(pose @ se3.exp(-d), in_cam)) / 2e-6).ravel()
            for d in e
        ],
        axis=1,
    )
    assert ekf._cov[6:, :6] == pytest.approx(g @ cov_pose, rel=1e-5, abs=1e-12)
    between = g[:3] @ cov_pose @ g[3:6].T
    assert ekf._cov[6:9, 9:12] == pytest.approx(between, rel=1e-5, abs=1e-12)
