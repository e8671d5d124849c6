"""Small dense linear algebra: products over stacks, symmetry, and factors of matrices that mix metres and radians.

Such matrices have condition numbers of 10¹⁰, so each of them is scaled by its own diagonal before it is factored.
"""

import numpy as np

from .. import core
from .se3 import Array

# m², rad², or of an amplitude: added where something is known by definition, such as the first camera, so that its
# covariance has a root and an inverse. A micrometre and a microradian are far below the error of any estimate.
LEAST_VARIANCE = 1e-12


def symmetric(a: Array) -> Array:
    """Return (A + Aᵀ)/2 of matrices (…, n, n)."""
    return np.asarray(0.5 * (a + a.swapaxes(-1, -2)))


def symmetric_inverse(a: Array) -> Array:
    """Return the inverses of symmetric matrices (…, n, n), symmetric to the last digit."""
    return symmetric(np.asarray(np.linalg.inv(a)))


def matvec(a: Array, x: Array) -> Array:
    """Return the products A x of stacked matrices (…, m, n) and vectors (…, n)."""
    return np.asarray((a @ x[..., None])[..., 0])


def mahalanobis2(errors: Array, cov: Array) -> Array:
    """Return eᵀ Σ⁻¹ e (n,) of errors (n, d) with covariances (n, d, d)."""
    return np.asarray(np.einsum("ni,ni->n", errors, np.linalg.solve(cov, errors[..., None])[..., 0]))


def scaled_cholesky(covariance: Array) -> Array:
    """Return L (n, n) with L Lᵀ = `covariance`, lower triangular. Raises LinAlgError if it is not definite."""
    scale = np.sqrt(np.diag(covariance))
    return np.asarray(scale[:, None] * np.linalg.cholesky(covariance / np.outer(scale, scale)))


class Cholesky:
    """Factor of a symmetric positive definite matrix A (n, n): `root` is R, upper triangular, with R Rᵀ = A⁻¹.

    Only the lower triangle of A is read.

    With `repair`, a matrix that has lost definiteness to rounding gets the smallest diagonal increase that restores it.
    Raises LinAlgError if A is not positive definite.
    """

    def __init__(self, matrix: Array, repair: bool = True) -> None:
        self.root = core.inverse_root(matrix, repair)

    def solve(self, right: Array) -> Array:
        """Return A⁻¹ b for b (n,) or (n, k)."""
        return np.asarray(self.root @ (self.root.T @ right))

    def inverse(self) -> Array:
        """Return A⁻¹, symmetric."""
        return symmetric(self.root @ self.root.T)
