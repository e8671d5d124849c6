"""The iterated, camera-centred filter: Jacobians, one update against dense least squares, consistency."""

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.baselines.iterated_ekf import IteratedEkf
from stream_sfm.estimators.cross_frame.inverse_depth import homogeneous_from_q, q_from_homogeneous
from stream_sfm.geometry import se3
from stream_sfm.simulation.scenes import Scene


def in_new_camera(motion, q):
    return q_from_homogeneous(homogeneous_from_q(q) @ motion.T)


def differences(function, size, step=1e-6):
    """∂f/∂x at 0 by central differences; f takes (size,) and returns (m,)."""
    e = step * np.eye(size)
    return np.stack([(function(d) - function(-d)) / (2 * step) for d in e], axis=1)


@pytest.fixture
def running(arc):
    """A filter after three frames, the views of the fourth, and the rows of its points in them."""
    ekf = IteratedEkf(arc.projection, Config())
    for o in arc.observations[:3]:
        ekf.step(o)
    o = arc.observations[3]
    ekf._drop(np.isin(ekf._ids, o.track_ids))
    rows = np.searchsorted(o.track_ids, ekf._ids)
    motion = se3.inverse(arc.world_from_cam[3]) @ arc.world_from_cam[2]
    return ekf, o.z_px[rows], o.cov_px[rows], motion


def test_jacobians_are_those_of_differences(running):
    ekf, _, _, motion = running
    q, n = ekf._q, len(ekf._q)
    views, by_q, by_motion = ekf._linearise(motion, q)

    def of_motion(xi):
        return ekf._linearise(se3.exp(xi) @ motion, q)[0].ravel()

    def of_points(x):
        return ekf._linearise(motion, q + x.reshape(-1, 3))[0].ravel()

    numerical = differences(of_motion, 6)
    assert by_motion.reshape(-1, 6) == pytest.approx(numerical, rel=1e-6, abs=1e-4)
    dense = np.zeros((n, 4, n, 3))
    dense[np.arange(n), :, np.arange(n), :] = by_q
    assert dense.reshape(4 * n, 3 * n) == pytest.approx(differences(of_points, 3 * n), rel=1e-6, abs=1e-4)
    assert views.shape == (n, 4)


def test_the_update_is_the_minimum_of_prior_and_views(running):
    """Gauss-Newton in information form, without S, over (ξ, ω, q), to convergence."""
    ekf, z, cov, motion = running
    n, d = len(ekf._q), len(ekf._cov)
    start = se3.exp([0.02, -0.01, 0.02, 2e-3, -2e-3, 1e-3]) @ motion
    found = ekf._update(z, cov, np.arange(n), start)

    prior = ekf._cov
    information = np.linalg.inv(prior)
    weight = np.zeros((n, 4, n, 4))
    weight[np.arange(n), :, np.arange(n), :] = np.linalg.inv(cov)
    weight = weight.reshape(4 * n, -1)
    m, x = start, np.zeros(d)
    for _ in range(20):
        views, by_q, by_motion = ekf._linearise(m, ekf._q + x[6:].reshape(-1, 3))
        h = np.zeros((n, 4, n, 3))
        h[np.arange(n), :, np.arange(n), :] = by_q
        j = np.concatenate([by_motion.reshape(-1, 6), np.zeros((4 * n, 6)), h.reshape(4 * n, -1)], axis=1)
        normal = j.T @ weight @ j
        normal[6:, 6:] += information
        right = j.T @ weight @ (z - views).ravel()
        right[6:] -= information @ x
        scale = 1 / np.sqrt(np.diag(normal))
        step = scale * np.linalg.solve(normal * np.outer(scale, scale), scale * right)
        m, x = se3.exp(step[:6]) @ m, x + step[6:]
    posterior = np.outer(scale, scale) * np.linalg.inv(normal * np.outer(scale, scale))

    std = np.sqrt(np.diag(posterior))
    # iterations end at a hundredth of σ
    assert np.abs(se3.log(found.cam_from_previous @ se3.inverse(m)) / std[:6]).max() < 0.01
    assert np.abs((found.x - x) / std[6:]).max() < 0.01  # the same
    joint = np.block([[found.cov_motion, found.cross.T], [found.cross, found.cov]])
    assert np.abs((joint - posterior) / np.outer(std, std)).max() < 0.01  # and the linearisation point with them


def test_the_state_is_carried_over_as_differences_say(running):
    """δω' and δq' of a new camera, by perturbing ξ, ω and q, with the joint covariance of all three."""
    ekf, z, cov, motion = running
    n = len(ekf._q)
    world, q = ekf._world_from_cam, ekf._q
    found = ekf._update(z, cov, np.arange(n), motion)
    now, moved = q + found.x[6:].reshape(-1, 3), found.cam_from_previous
    new_world = world @ se3.exp(found.x[:6]) @ se3.inverse(moved)

    def carried(error):
        """(ω', q') of a state that is off by `error` = (ξ, ω, q)."""
        there = world @ se3.exp(found.x[:6]) @ se3.exp(error[6:12]) @ se3.inverse(se3.exp(error[:6]) @ moved)
        points = in_new_camera(se3.exp(error[:6]) @ moved, now + error[12:].reshape(-1, 3))
        return np.concatenate([se3.log(se3.inverse(new_world) @ there), points.ravel()])

    j = differences(carried, 12 + 3 * n)
    joint = np.block([[found.cov_motion, found.cross.T], [found.cross, found.cov]])
    expected = j @ joint @ j.T
    ekf._carry_over(found)
    std = np.sqrt(np.diag(expected))
    assert np.abs((ekf._cov - expected) / np.outer(std, std)).max() < 1e-5
    assert se3.log(se3.inverse(new_world) @ ekf._world_from_cam) == pytest.approx(np.zeros(6), abs=1e-9)
    assert ekf._q == pytest.approx(in_new_camera(moved, now), abs=1e-12)


@pytest.mark.slow
def test_consistent_and_level_with_the_window():
    """Twelve scenes with 0.289 px of noise: NEES 6 and 3, and the window's errors to a few per cent (same noise)."""
    nees, points, squares = [], [], {"iterated-ekf": 0.0, "cross-frame": 0.0}
    for seed in range(12):
        s = Scene(track_length=8, frames=26).sequence(np.random.SeedSequence([7, seed]))
        for name in squares:
            estimator = make_estimator(name, s.projection, Config())
            for n, o in enumerate(s.observations):
                found = estimator.step(o)
                if n in (15, 20, 25):
                    xi = se3.log(se3.inverse(found.world_from_cam) @ s.world_from_cam[n])
                    squares[name] += float(xi[:3] @ xi[:3])
                    if name == "iterated-ekf":
                        nees.append(float(xi @ np.linalg.solve(found.cov_pose, xi)))
                        true = se3.transform(se3.inverse(s.world_from_cam[n]), s.points_in_world[found.track_ids])
                        e = true - found.points_in_cam
                        points.append(
                            float(np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.cov_points), e).mean())
                        )
    # the mean of 12 scenes scatters by √(12/12) = 1 (three frames of a scene are hardly more than one)
    assert abs(np.mean(nees) - 6) < 3
    assert abs(np.mean(points) - 3) < 0.42  # a scene's points share its pose: of one scene 0.5
    assert squares["iterated-ekf"] / squares["cross-frame"] == pytest.approx(1, abs=0.1)
