"""Small linear algebra on matrices that mix metres and radians: factors, inverses, and refused matrices."""

import numpy as np
import pytest

from stream_sfm.geometry.linear import Cholesky, scaled_cholesky

RNG = np.random.default_rng(11)
SCALE = np.array([1e6, 1e3, 1.0, 1e-3, 1e-4, 1e-5])  # units: a condition number of 10²² without scaling
ROUNDING = 1e-12  # relative to the diagonal; the scaled matrix has a condition number below 10³


def test_badly_scaled_matrices_are_factored_and_inverted() -> None:
    a, scale = RNG.normal(size=(6, 6)), np.outer(SCALE, SCALE)
    cov = (a @ a.T + np.eye(6)) * scale
    root = scaled_cholesky(cov)
    assert (np.triu(root, 1) == 0).all()
    assert np.abs((root @ root.T - cov) / scale).max() < ROUNDING * 100  # entries up to some tens
    inverse = Cholesky(cov).inverse()
    assert np.abs(inverse * scale @ (cov / scale) - np.eye(6)).max() < ROUNDING
    assert (inverse == inverse.T).all()
    right = RNG.normal(size=6) / SCALE
    assert Cholesky(cov).solve(cov @ right) == pytest.approx(right, rel=1e-9)


def test_lost_definiteness_is_repaired_only_on_request() -> None:
    v = RNG.normal(size=(6, 5))
    nearly = v @ v.T - 1e-12 * np.eye(6)  # rank 5, less a rounding
    with pytest.raises(np.linalg.LinAlgError):
        Cholesky(nearly, repair=False)
    assert np.isfinite(Cholesky(nearly).root).all()
    with pytest.raises(np.linalg.LinAlgError):
        Cholesky(-np.eye(3))
