"""Dense linear algebra of the estimators: scaled Cholesky, inverse, its root.

Every matrix is scaled by its diagonal before it is factored: metres against radians give condition numbers of 10¹⁰.
"""

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from .se3 import Array


def symmetric(a: NDArray) -> Array:
    """(A + Aᵀ)/2 of (…, n, n)."""
    return 0.5 * (a + np.swapaxes(a, -1, -2))


class Cholesky:
    """Factor of a symmetric positive definite matrix A (n, n), scaled by its diagonal: `root` R with R Rᵀ = A⁻¹.

    A matrix that has lost definiteness to rounding gets the smallest diagonal increase that restores it, if `repair`.
    Raises LinAlgError where A is not positive definite.
    """

    def __init__(self, matrix: Array, repair: bool = True) -> None:
        diagonal = np.diag(matrix)
        scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        scaled = matrix * scale[:, None] * scale
        for damping in (0.0, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5) if repair else (0.0,):
            if damping:
                scaled[np.diag_indices_from(scaled)] += damping
            with suppress(np.linalg.LinAlgError):
                factor = np.linalg.cholesky(scaled)
                self.root: Array = scale[:, None] * np.linalg.inv(factor).T
                return
        raise np.linalg.LinAlgError("information matrix is not positive definite")

    def solve(self, right: Array) -> Array:
        """A⁻¹ b for (n,) or (n, k)."""
        solution: Array = self.root @ (self.root.T @ right)
        return solution

    def inverse(self) -> Array:
        """A⁻¹, symmetric."""
        return symmetric(self.root @ self.root.T)
