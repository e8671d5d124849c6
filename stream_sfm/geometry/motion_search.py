"""The global search of the resection: the motion that most of the weight agrees with, whatever the start.

Motions are fitted to many small random samples of views, each from two beginnings; all are scored by all views at the
views' own noise, with truncated costs, so that an outlier counts the same however far off it is; the best ones are
refined by all views near them. Everything is done for all samples at once.
"""

import math

import numpy as np
from numpy.typing import NDArray

from . import se3
from .linear import damped_solve, matvec
from .medians import CAUCHY_WIDTH
from .point_views import PointViews
from .se3 import MAX_ROTATION_STEP_RAD, Array
from .stereo import clamp_depth

# Closed form: with 60 % outliers, P(no clean sample) is (1 - 0.4**3)**256 < 1e-7 for stereo views and
# (1 - 0.4**4)**256 = 0.0013 for views of one side.
_SAMPLES = 256
_CLEAN_SAMPLES = 20  # among them, on average, where it is known how many views agree: some noise makes useless
_STEREO_SAMPLE = 3  # two views determine a motion; a third keeps its noise from being levered up
_ONE_SIDED_SAMPLE = 4  # three have up to four solutions
_SAMPLE_STEPS = 4  # Gauss-Newton from a rough beginning: the fifth changes nothing that the ranking sees
_REFINED = 12  # of the best samples: their order is rough, because few noisy views fix a motion only roughly
# Widths, in gates, within which views refine a motion: first the neighbourhood of a rough one, then its own views.
_REFINING_WIDTHS = (16.0, 4.0)
_REFINING_STEPS = 2
# The extent decides where history does not: it makes a factor of .56 at the least, since a background may be seen
# through a gap between bodies.
_EXTENT_POWER, _MIN_EXTENT = 0.25, 0.1
_PLACES = 8  # per side of the image: as many places as can be told apart by a hundred tracks


def search_motion(views: PointViews, start: Array, weights: Array, agreeing: int | None = None) -> Array:
    """Return the motion cam_from_ref (4, 4) with the largest `support`; `weights` (n,) are at least 0.

    `start` (4, 4) is one of two beginnings of each sample, the other one is taken from its rays. `agreeing`: with how
    many of the views the motion agrees at least, if that is known: among few views few samples then find it.
    Deterministic: samples depend on the number of views only.
    """
    n = len(views)
    size = _STEREO_SAMPLE if np.mean(views.sides == 4) > 0.5 else _ONE_SIDED_SAMPLE
    samples = _SAMPLES
    if agreeing is not None:
        samples = min(samples, math.ceil(_CLEAN_SAMPLES * math.comb(n, size) / math.comb(agreeing, size)))
    rows = _draw(weights, size, samples)
    root, _ = views.linearise(start)
    from_rays = _rotations_by_rays(views.points[rows], views.projection.rays(views.z_px[rows]))
    motions = np.concatenate([np.broadcast_to(start, from_rays.shape), from_rays])
    rows = np.concatenate([rows, rows])
    motions = _fit(views, root, motions, rows, np.ones(rows.shape), _SAMPLE_STEPS)
    motions = motions[np.argsort(-support(views, motions, root, weights), kind="stable")[:_REFINED]]
    every = np.broadcast_to(np.arange(n), (len(motions), n))
    for width in _REFINING_WIDTHS:
        s2 = views.squared_residuals(motions, root)
        near = s2 < width * views.gate
        motions = _fit(views, root, motions, every, near * weights / (1 + s2 / CAUCHY_WIDTH**2), _REFINING_STEPS)
    return np.asarray(motions[int(np.argmax(support(views, motions, root, weights)))])


def support(views: PointViews, cams_from_ref: Array, root: Array, weights: Array) -> Array:
    """Return the support (m,) of each of many motions (m, 4, 4).

    Each view gives its weight, less the share of the gate that its squared residual uses up; the extent that the
    agreeing views have in the image adds a little. A background surrounds what moves in front of it, and a body is
    compact.
    """
    agreement = weights * (1 - np.minimum(views.squared_residuals(cams_from_ref, root) / views.gate, 1.0))
    total = agreement.sum(axis=1)
    return np.asarray(total * np.maximum(_extent(views, agreement), _MIN_EXTENT) ** _EXTENT_POWER)


def evidence(views: PointViews, weights: Array) -> float:
    """Return how strongly views with these weights (n,) look like the background.

    Each place of the image has one vote, as large as its largest weight; their sum counts times their extent. A body
    may have as many corners as it likes.
    """
    p = views.projection
    column = np.clip(views.z_px[:, 0] * (_PLACES / p.width), 0, _PLACES - 1).astype(int)
    row = np.clip(views.z_px[:, 1] * (_PLACES / p.height), 0, _PLACES - 1).astype(int)
    votes = np.zeros(_PLACES**2)
    np.maximum.at(votes, _PLACES * row + column, weights)
    return float(votes.sum() * max(_extent(views, weights[None])[0], _MIN_EXTENT))


def _extent(views: PointViews, agreement: Array) -> Array:
    """Return the area (m,) over which agreement (m, n) spreads: 1 where it is uniform over the image."""
    p = views.projection
    u, v = (views.z_px[:, 0] - p.cx_left_px) / p.width, (views.z_px[:, 1] - p.cy_px) / p.height
    moments = agreement @ np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    _, mu, mv, uu, uv, vv = (moments / np.maximum(moments[:, :1], 1e-12)).T
    determinant = (uu - mu * mu) * (vv - mv * mv) - (uv - mu * mv) ** 2
    return np.asarray(12.0 * np.sqrt(np.maximum(determinant, 0.0)))  # a uniform square has variances of 1/12


def _draw(weights: Array, size: int, samples: int) -> NDArray[np.intp]:
    """Return samples (samples, size) of different rows each, drawn by weight (Efraimidis and Spirakis 2006)."""
    rng = np.random.default_rng(len(weights))
    keys = np.log(rng.random((samples, len(weights)))) / np.maximum(weights, 1e-9)
    return np.argpartition(-keys, size, axis=1)[:, :size]


def _rotations_by_rays(points: Array, rays: Array) -> Array:
    """Return the rotations, as motions (m, 4, 4), that turn points (m, k, 4) best towards rays (m, k, 2)."""
    source = points[..., :3] / np.linalg.norm(points[..., :3], axis=-1, keepdims=True)
    target = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)
    target = target / np.linalg.norm(target, axis=-1, keepdims=True)
    u, _, vt = np.linalg.svd(np.swapaxes(target, 1, 2) @ source)
    u[:, :, 2] *= (np.linalg.det(u) * np.linalg.det(vt))[:, None]
    return se3.from_rotation_translation(u @ vt, np.zeros((len(points), 3)))


def _fit(
    views: PointViews, root: Array, motions: Array, rows: NDArray[np.intp], weights: Array, steps: int
) -> Array:
    """Refine each of motions (m, 4, 4) by Gauss-Newton over its own views `rows` (m, k) with `weights` (m, k)."""
    points, z, root = views.points[rows], np.nan_to_num(views.z_px)[rows], root[rows]
    for _ in range(steps):
        in_cam = clamp_depth(points @ np.swapaxes(motions, -1, -2))
        a = root @ views.projection.jacobian_homogeneous(in_cam)[..., :3]
        j = np.concatenate([a * in_cam[..., None, 3:], -a @ se3.skew(in_cam[..., :3])], axis=-1)
        r = matvec(root, z - views.projection.project_homogeneous(in_cam))
        jt = np.swapaxes((j * weights[..., None, None]).reshape(len(motions), -1, 6), 1, 2)
        h = jt @ j.reshape(len(motions), -1, 6)
        delta = damped_solve(h, matvec(jt, r.reshape(len(motions), -1)))
        delta = np.where(np.isfinite(delta), delta, 0.0)
        angle = np.linalg.norm(delta[:, 3:], axis=1, keepdims=True)
        motions = se3.exp(delta * np.minimum(1.0, MAX_ROTATION_STEP_RAD / np.maximum(angle, 1e-12))) @ motions
    return motions
