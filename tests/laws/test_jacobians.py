"""Every analytic Jacobian of the projection and of the window against central differences."""

import numpy as np

from stream_sfm.core import _core
from stream_sfm.estimators.window.inverse_depth import State, linearise
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.rig_model.model import FIELD_MOVES
from stream_sfm.rig_model.terms import TERMS
from tests.helpers.estimators import (
    dense_system,
    homogeneous_from_q,
    in_reference,
    q_from_homogeneous,
    window_views,
)

P = StereoProjection(600.0, 250.0, 262.0, 240.0, 0.25, 512, 480)
RNG = np.random.default_rng(3)
POINTS = np.stack([RNG.uniform(-1, 1, 40), RNG.uniform(-1, 1, 40), RNG.uniform(1.5, 8, 40)], axis=1)
HOMOGENEOUS = np.concatenate([POINTS, RNG.uniform(0, 2, (40, 1))], axis=1)


def differences(function, x: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """∂f/∂x (n, m, k) for f: (n, k) -> (n, m), by central differences."""
    columns = []
    for k in range(x.shape[-1]):
        h = np.zeros(x.shape[-1])
        h[k] = step
        columns.append((function(x + h) - function(x - h)) / (2 * step))
    return np.stack(columns, axis=-1)


def test_jacobian_of_the_projection_equals_differences():
    numerical = differences(P.project, POINTS)
    assert np.abs(P.jacobian(POINTS) - numerical).max() < 1e-6 * np.abs(numerical).max()


def test_drift_in_the_reference_camera_is_carried_into_anchors():
    anchors = se3.exp(RNG.normal(size=(10, 6)) * 0.1)
    here = q_from_homogeneous(HOMOGENEOUS[:10])

    def in_anchor(q):
        return q_from_homogeneous((se3.inverse(anchors) @ homogeneous_from_q(q)[..., None])[..., 0])

    drift, ids = RNG.uniform(1, 2, (10, 3)), np.arange(10)
    j = differences(in_anchor, here)
    expected = (j * drift[:, None]) @ np.swapaxes(j, 1, 2)
    found = _core._drift_covariances(ids, anchors, in_anchor(here), ids[1:], drift[1:])
    assert np.abs(found[1:] - expected[1:]).max() < 1e-6 * np.abs(expected).max()
    assert (found[0] == 0).all()


def test_projection_and_triangulation_are_inverse():
    assert np.allclose(P.triangulate(P.project(POINTS)), POINTS, atol=1e-12)
    assert np.allclose(P.project_homogeneous(np.c_[POINTS, np.ones(40)]), P.project(POINTS), atol=1e-12)


def test_normal_equations_equal_those_of_a_numerical_jacobian():
    frames, n, terms, basis, e = 3, 12, len(TERMS), 5, 2
    cams = se3.exp(RNG.normal(size=(frames, 6)) * 0.05)
    anchors = se3.exp(RNG.normal(size=(n, 6)) * 0.1)
    q = q_from_homogeneous(np.c_[se3.transform(se3.inverse(anchors), POINTS[:n, None])[:, 0], np.ones(n)])
    z = P.project_homogeneous(in_reference(anchors, q)[None] @ np.swapaxes(cams, 1, 2)) + RNG.normal(
        size=(frames, n, 4)
    )
    frame, point = np.nonzero(RNG.random((frames, n)) < 0.8)
    v = len(frame)
    roots = RNG.normal(size=(v, 4, 4))
    effects = [RNG.normal(size=shape) for shape in ((v, 4, terms), (v, 4, 2), (v, basis))]
    m = terms + FIELD_MOVES.shape[1] * basis
    by_own = RNG.normal(size=(v, 4, e))
    views = window_views(frame, point, z[frame, point], roots, *effects, own=by_own)
    rig_error, own = RNG.normal(size=m), RNG.normal(size=(frames, e))
    of_frames = (6 + e) * frames
    end = of_frames + 3 * n

    def residual(x: np.ndarray) -> np.ndarray:
        of_frame = x[:of_frames].reshape(frames, 6 + e)
        poses, amplitudes = se3.exp(of_frame[:, :6]) @ cams, own + of_frame[:, 6:]
        points = q + x[of_frames:end].reshape(n, 3)
        in_cam = (poses[frame] @ in_reference(anchors, points)[point][..., None])[..., 0]
        off_px = views.z_px - P.project_homogeneous(in_cam) - views.shift_px(rig_error + x[end:])
        off_px -= (by_own @ amplitudes[frame][..., None])[..., 0]
        return np.concatenate([(roots @ off_px[..., None]).ravel(), -amplitudes.ravel()])  # with their prior

    size = end + m
    j = np.stack([(residual(h) - residual(-h)) / 2e-6 for h in 1e-6 * np.eye(size)], axis=1)
    h, g = j.T @ j, -j.T @ residual(np.zeros(size))
    lin = linearise(P, State(cams, np.arange(n), anchors, q, rig_error, own), views)
    dense, right = dense_system(lin)
    assert np.abs(h - dense).max() < 1e-6 * np.abs(h).max()
    assert np.abs(g - right).max() < 1e-6 * np.abs(g).max()
