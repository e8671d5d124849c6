"""Dense linear algebra of the estimators: scaled Cholesky, inverse, its root.

Every matrix is scaled by its diagonal before it is factored: metres against radians give condition numbers of 10¹⁰.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from ..geometry.pose import Array


def symmetric(a: NDArray) -> Array:
    """(A + Aᵀ)/2 of (…, n, n)."""
    return 0.5 * (a + np.swapaxes(a, -1, -2))


class Cholesky:
    """Factor of a symmetric positive definite matrix (n, n), scaled by its diagonal.

    A matrix that has lost definiteness to rounding gets the smallest diagonal increase that restores it.
    """

    def __init__(self, matrix: Array) -> None:
        diagonal = np.diag(matrix)
        self.scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        scaled = matrix * self.scale[:, None] * self.scale
        for damping in (0.0, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5):
            if damping:
                scaled[np.diag_indices_from(scaled)] += damping
            self.factor, failed = lapack.dpotrf(scaled, lower=1, clean=1)
            if not failed:
                return
        raise np.linalg.LinAlgError("information matrix is not positive definite")

    def solve(self, right: Array) -> Array:
        """A⁻¹ b for (n,) or (n, k)."""
        b = right.reshape(len(right), -1)
        x, _ = lapack.dpotrs(self.factor, self.scale[:, None] * b, lower=1)
        return (self.scale[:, None] * x).reshape(right.shape)

    def inverse(self) -> Array:
        """A⁻¹, symmetric."""
        inv, _ = lapack.dpotri(self.factor, lower=1)
        low = np.tril(inv)
        return (low + np.tril(low, -1).T) * self.scale[:, None] * self.scale

    def inverse_root(self) -> Array:
        """R (n, n) with R Rᵀ = A⁻¹."""
        inv, _ = lapack.dtrtri(self.factor, lower=1)
        return self.scale[:, None] * inv.T
