"""What tests of estimators share: a run, a frame without views, and how consistent poses and points are."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from stream_sfm.config import Config
from stream_sfm.core import NormalBlocks
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.window.inverse_depth import WhitenedViews
from stream_sfm.geometry import se3
from stream_sfm.geometry.linear import mahalanobis2
from stream_sfm.geometry.se3 import Array
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.simulation.scenes import Sequence
from stream_sfm.types import Observations, Solution


def run(
    method: str, projection: StereoProjection, observations: Iterable[Observations], config: Config | None = None
) -> list[Solution]:
    estimator = make_estimator(method, projection, Config() if config is None else config)
    assert estimator.name == method
    return [estimator.step(o) for o in observations]


def without_views(o: Observations) -> Observations:
    return replace(o, track_ids=o.track_ids[:0], z_px=o.z_px[:0], cov_px=o.cov_px[:0], n_new=0)


def nees(pose: Array, cov: Array, true: Array) -> float:
    """The squared error of a pose in its own covariance (6, 6): 6 is expected."""
    xi = se3.log(se3.inverse(pose) @ true)
    return float(xi @ np.linalg.solve(cov, xi))


def nees_of_points(found: Solution, sequence: Sequence) -> float:
    """The mean over the points in the world: 3 is expected."""
    errors = sequence.points_in_world[found.track_ids] - found.points_in_world
    return float(mahalanobis2(errors, found.cov_points_in_world).mean())


def q_from_homogeneous(points: Array) -> Array:
    """q = (X, Y, ρ)/Z (…, 3) of homogeneous points (X, Y, Z, ρ) (…, 4)."""
    return np.asarray(points[..., [0, 1, 3]] / points[..., 2:3])


def window_views(
    frame: np.ndarray,
    ids: np.ndarray,
    z_px: np.ndarray,
    root: np.ndarray,
    terms: Array,
    *effects: Array,
    own: Array | None = None,
) -> WhitenedViews:
    """Views that are all used, of both sides, whose errors are independent; `effects`: of timing and field, if any.

    `own` (n, 4, e): what the views of a frame err by in common.
    """
    n = len(ids)
    every, rest = np.ones(n, bool), effects or (np.zeros((n, 4, 0)), np.zeros((n, 0)))
    own = np.zeros((n, 4, 0)) if own is None else own
    return WhitenedViews(
        frame, ids, z_px, root, np.ones((n, 4)), every, every, z_px, np.zeros((n, 3)), own, terms, *rest
    )


def homogeneous_from_q(q: Array) -> Array:
    """Return homogeneous points (…, 4) of q (…, 3) in the anchor."""
    return np.stack([q[..., 0], q[..., 1], np.ones(q.shape[:-1]), q[..., 2]], axis=-1)


def dense_system(lin: NormalBlocks) -> tuple[Array, Array]:
    """Matrix and right side of a window's normal equations, over frames, points and errors of the rig."""
    a, b, m = lin.g_pose.size, 3 * len(lin.v), len(lin.rig)
    h = np.zeros((a + b + m, a + b + m))
    h[a : a + b, :a] = lin.w.reshape(b, a)
    h[a + b :, :a] = lin.rig_pose.reshape(a, m).T
    h[a + b :, a : a + b] = lin.rig_point.reshape(b, m).T
    h += h.T
    for first, blocks in ((0, lin.u), (a, lin.v), (a + b, lin.rig[None])):
        size = blocks.shape[1]
        for at, block in zip(range(first, first + size * len(blocks), size), blocks, strict=True):
            h[at : at + size, at : at + size] = block
    return h, np.concatenate([lin.g_pose.ravel(), lin.g_point.ravel(), lin.g_rig])


def without_own(lin: NormalBlocks) -> tuple[Array, Array, float]:
    """The dense system with the amplitudes that frames have of their own marginalised: over poses, points and rig.

    And the decrease of the sum of squares by these alone.
    """
    h, g = dense_system(lin)
    frames, f = lin.g_pose.shape
    own = np.zeros(len(g), bool)
    own[: frames * f].reshape(frames, f)[:, 6:] = True
    gain = np.linalg.solve(h[own][:, own], h[own]).T[~own]
    decrease = float(g[own] @ np.linalg.solve(h[own][:, own], g[own]))
    return h[~own][:, ~own] - gain @ h[own][:, ~own], g[~own] - gain @ g[own], decrease


def point_blocks(cov: Array) -> Array:
    """The blocks (n, 3, 3) on the diagonal of the covariance (3n, 3n) of all points."""
    n = len(cov) // 3
    return np.asarray(cov.reshape(n, 3, n, 3)[range(n), :, range(n), :])


def in_reference(ref_from_anchor: Array, q: Array) -> Array:
    """Homogeneous points (P, 4) in the reference camera of q (P, 3); `ref_from_anchor` (P, 4, 4)."""
    return np.asarray((ref_from_anchor @ homogeneous_from_q(q)[..., None])[..., 0])
