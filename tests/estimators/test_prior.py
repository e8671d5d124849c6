"""The factored prior and the window's system against the same Gaussians written out densely."""

import numpy as np
import pytest

from stream_sfm.estimators.cross_frame.inverse_depth import (
    WhitenedViews,
    homogeneous_from_q,
    in_reference,
    linearise,
    pose_jacobian,
    q_from_homogeneous,
    q_jacobian,
)
from stream_sfm.estimators.cross_frame.normal_equations import System
from stream_sfm.estimators.cross_frame.prior import Prior
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection

P = StereoProjection(600.0, 250.0, 262.0, 240.0, 0.25, 512, 480)
N, K = 9, 8


def spd(rng, count: int, size: int, scale: float) -> np.ndarray:
    a = rng.normal(size=(count, size, size))
    return scale * (a @ np.swapaxes(a, 1, 2) + 0.3 * np.eye(size))


@pytest.fixture
def prior() -> Prior:
    rng = np.random.default_rng(5)
    anchors = se3.exp(0.1 * rng.normal(size=(N, 6)))
    points = np.stack([rng.uniform(-1, 1, N), rng.uniform(-1, 1, N), rng.uniform(2, 6, N), np.ones(N)], axis=1)
    q = q_from_homogeneous((se3.inverse(anchors) @ points[..., None])[..., 0])
    return Prior(
        ids=np.arange(N),
        ref_from_anchor=anchors,
        mean=q,
        cov=spd(rng, N, 3, 1e-6),
        modes=1e-3 * rng.normal(size=(N, 3, K)),
        world_from_ref=se3.exp(rng.normal(size=6)),
        world_modes=1e-3 * rng.normal(size=(6, K)),
    )


def dense(prior: Prior) -> np.ndarray:
    """Joint covariance of all q and ω."""
    modes = np.concatenate([prior.modes.reshape(3 * len(prior.ids), -1), prior.world_modes])
    cov = modes @ modes.T
    for i, block in enumerate(prior.cov):
        cov[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += block
    return cov


def test_absorbing_a_frame_is_a_kalman_update_with_an_unknown_pose(prior) -> None:
    rng = np.random.default_rng(6)
    y, x = rng.normal(size=K), se3.exp(0.05 * rng.normal(size=6))
    q = prior.points(y)  # linearised at the prior's own prediction, so that means can be compared linearly
    v, g = spd(rng, N, 3, 1e5), 300 * rng.normal(size=(N, 3))
    v[2], g[2] = 0, 0  # not seen
    after = prior.absorb_frame(y, x, q, v, g)

    anchors = se3.orthonormalise(x @ prior.ref_from_anchor)
    by_pose = q_jacobian(homogeneous_from_q(q)) @ se3.inverse(anchors) @ pose_jacobian(in_reference(anchors, q))
    # [q, ω, ξ] -> [q', ω'], ξ as good as unknown beside millimetres
    carry = np.zeros((3 * N + 6, 3 * N + 12))
    carry[: 3 * N, : 3 * N] = np.eye(3 * N)
    carry[: 3 * N, 3 * N + 6 :] = by_pose.reshape(3 * N, 6)
    carry[3 * N :, 3 * N : 3 * N + 6] = se3.adjoint(x)
    carry[3 * N :, 3 * N + 6 :] = -np.eye(6)
    joint = np.zeros((3 * N + 12, 3 * N + 12))
    joint[:-6, :-6], joint[-6:, -6:] = dense(prior), 1e2 * np.eye(6)
    before = carry @ joint @ carry.T
    info = np.zeros_like(before)
    for i, block in enumerate(v):
        info[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    # the prior's mean at modes 0, seen from the state at modes y
    away = carry[:, :-6] @ np.concatenate([(prior.mean - q).ravel(), -prior.world_modes @ y])
    right = np.concatenate([g.ravel(), np.zeros(6)])
    gain = before @ np.linalg.inv(np.eye(len(before)) + info @ before)
    mean = away + gain @ (right - info @ away)
    scale = np.sqrt(np.diag(gain))
    assert np.abs((dense(after) - gain) / np.outer(scale, scale)).max() < 1e-4
    assert np.abs((after.mean - q).ravel() - mean[:-6]).max() < 1e-3 * scale[:-6].min()
    centre = prior.world(y) @ se3.inverse(x)
    moved = se3.log(se3.inverse(centre) @ after.world_from_ref)
    assert np.abs(moved - mean[-6:]).max() < 1e-3 * scale[-6:].min()


def test_truncating_modes_keeps_every_marginal_and_the_world(prior) -> None:
    rng = np.random.default_rng(7)
    # two modes that hardly matter beside the points' own noise, and four that repeat others
    modes = np.concatenate([prior.modes, 1e-6 * rng.normal(size=(N, 3, 2)), prior.modes[..., :4]], axis=2)
    world_modes = np.concatenate([prior.world_modes, np.zeros((6, 2)), prior.world_modes[:, :4]], axis=1)
    full = Prior(prior.ids, prior.ref_from_anchor, prior.mean, prior.cov, modes, prior.world_from_ref, world_modes)
    small = full.truncate_modes()
    assert small.modes.shape[2] < modes.shape[2]
    a, b = dense(full), dense(small)
    scale = np.sqrt(np.diag(a))
    difference = np.abs(a - b) / np.outer(scale, scale)
    assert difference[-6:].max() < 1e-12  # the world, and every point's correlation with it
    marginal = difference[:-6, :-6].reshape(N, 3, N, 3)[np.arange(N), :, np.arange(N), :]
    assert marginal.max() < 1e-12
    assert difference.max() < 1e-3


def test_system_is_the_dense_solution(prior) -> None:
    rng = np.random.default_rng(8)
    frames, total = 2, N + 3  # three points that the prior does not know
    cams = se3.exp(0.05 * rng.normal(size=(frames, 6)))
    anchors = np.concatenate([prior.ref_from_anchor, np.broadcast_to(np.eye(4), (3, 4, 4))])
    q = np.concatenate([prior.mean, [[0.1, 0.2, 0.3], [-0.2, 0.1, 0.25], [0.0, -0.1, 0.4]]])
    frame, point = np.divmod(np.arange(frames * total), total)
    z = P.project_homogeneous((cams[frame] @ in_reference(anchors, q)[point][..., None])[..., 0])
    views = WhitenedViews(
        frame, point, z + rng.normal(size=z.shape), np.broadcast_to(2 * np.eye(4), (len(z), 4, 4)), np.ones(z.shape)
    )
    lin = linearise(P, cams, anchors, q, views)
    known = np.arange(N)
    system = System(prior, known, lin)
    dx, dq, dy, decrease = system.step(lin.g_pose, lin.g_point, q, np.zeros(K))

    a, b = 6 * frames, 3 * total
    h = np.zeros((a + b + 6, a + b + 6))  # poses, points, world
    for s in range(frames):
        h[6 * s : 6 * s + 6, 6 * s : 6 * s + 6] = lin.u[s]
    h[a : a + b, :a] = lin.w.reshape(b, a)
    h[:a, a : a + b] = h[a : a + b, :a].T
    blocks = h[a : a + b, a : a + b].reshape(total, 3, total, 3)
    blocks[np.arange(total), :, np.arange(total), :] += lin.v
    with_prior = np.concatenate([a + np.arange(3 * N), a + b + np.arange(6)])
    h[np.ix_(with_prior, with_prior)] += np.linalg.inv(dense(prior))
    g = np.concatenate([lin.g_pose.ravel(), lin.g_point.ravel(), np.zeros(6)])
    cov = np.linalg.inv(h)
    delta = cov @ g
    scale = np.sqrt(np.diag(cov))
    found = np.concatenate([dx.ravel(), dq.ravel(), prior.world_modes @ dy])
    assert np.abs((found - delta) / scale).max() < 1e-6
    assert decrease == pytest.approx(g @ delta, rel=1e-9)
    cov_q, cov_qx, cov_qw, cov_x, cov_w, cov_xw = system.covariances(frames - 1)
    x, w = slice(a - 6, a), slice(a + b, None)
    points = cov[a : a + b, a : a + b].reshape(total, 3, total, 3)[np.arange(total), :, np.arange(total), :]
    for mine, theirs, rows, columns in (
        (cov_q.reshape(b, 3), points.reshape(b, 3), scale[a : a + b], scale[a : a + b].min()),
        (cov_qx.reshape(b, 6), cov[a : a + b, x], scale[a : a + b], scale[x]),
        (cov_qw.reshape(b, 6), cov[a : a + b, w], scale[a : a + b], scale[w]),
        (cov_x, cov[x, x], scale[x], scale[x]),
        (cov_w, cov[w, w], scale[w], scale[w]),
        (cov_xw, cov[x, w], scale[x], scale[w]),
    ):
        assert np.abs((mine - theirs) / np.outer(rows, np.broadcast_to(columns, mine.shape[1]))).max() < 1e-5
