"""Drift inside the window against the same Gaussian written out with one point per frame."""

from dataclasses import replace

import numpy as np

from stream_sfm.estimators.cross_frame.inverse_depth import NormalBlocks
from stream_sfm.estimators.cross_frame.window_drift import with_drift

FRAMES, POINTS = 3, 4


def random_blocks(rng: np.random.Generator) -> tuple[NormalBlocks, np.ndarray]:
    """Normal equations of one view per point and frame, and its whitened Jacobians (F, P, 4, 9): pose, point."""
    j = rng.normal(size=(FRAMES, POINTS, 4, 9))
    products = np.swapaxes(j, 2, 3) @ j
    w = np.zeros((POINTS, 3, FRAMES, 6))
    w[:] = np.einsum("spij->pisj", products[..., 6:, :6])
    return NormalBlocks(
        u=products[..., :6, :6].sum(1),
        v=products[..., 6:, 6:].sum(0),
        w=w.reshape(POINTS, 3, 6 * FRAMES),
        g_pose=np.zeros((FRAMES, 6)),
        g_point=np.zeros((POINTS, 3)),
        v_by_frame=products[..., 6:, 6:],
    ), j


def dense(blocks: NormalBlocks) -> np.ndarray:
    """The information of all poses and points, (6F + 3P)²."""
    n = 6 * FRAMES
    h = np.zeros((n + 3 * POINTS, n + 3 * POINTS))
    for s in range(FRAMES):
        h[6 * s : 6 * s + 6, 6 * s : 6 * s + 6] = blocks.u[s]
    if blocks.coupling is not None:
        h[:n, :n] += blocks.coupling
    for i in range(POINTS):
        rows = slice(n + 3 * i, n + 3 * i + 3)
        h[rows, rows], h[rows, :n], h[:n, rows] = blocks.v[i], blocks.w[i], blocks.w[i].T
    return h


def test_drift_is_marginalised_exactly() -> None:
    rng = np.random.default_rng(0)
    blocks, j = random_blocks(rng)
    a = rng.normal(size=(FRAMES, POINTS, 3, 3))
    drift = a @ np.swapaxes(a, 2, 3)
    n, k = 6 * FRAMES, 3 * POINTS
    # poses, points before all steps, then the points in every frame
    h = np.zeros((n + k + FRAMES * k, n + k + FRAMES * k))
    for s in range(FRAMES):
        for i in range(POINTS):
            now, before = n + k + s * k + 3 * i, n + s * k + 3 * i
            columns = np.r_[6 * s : 6 * s + 6, now : now + 3]
            h[np.ix_(columns, columns)] += j[s, i].T @ j[s, i]
            step = np.r_[before : before + 3, now : now + 3]
            difference = np.concatenate([-np.eye(3), np.eye(3)], axis=1)
            h[np.ix_(step, step)] += difference.T @ np.linalg.inv(drift[s, i]) @ difference
    h += 1e-3 * np.diag(
        np.r_[np.ones(n + k), np.zeros(FRAMES * k)]
    )  # as a prior does; a step alone is not determined
    expected = np.linalg.inv(h)[: n + k, : n + k]
    found = np.linalg.inv(dense(with_drift(blocks, drift)) + 1e-3 * np.eye(n + k))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


def test_points_without_drift_stay_what_they_are() -> None:
    blocks, _ = random_blocks(np.random.default_rng(1))
    same = with_drift(blocks, np.zeros((FRAMES, POINTS, 3, 3)))
    np.testing.assert_allclose(dense(same), dense(replace(blocks, coupling=None)), atol=1e-12)
