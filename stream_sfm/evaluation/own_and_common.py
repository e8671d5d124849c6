"""How wrong σ is in two figures: of the errors of each motion, and of those of the rig, which all share, eq. (75a).

The errors of the rig are drawn once per run. So the error of all motions together over its σ says little, however many
motions there are: if these errors happen to be small, σ seems too large, and if the rig's part dominates, nothing is
seen of the rest. Given the errors c that explain the motions best, the own parts remain, of which there are many; and
c itself is compared with its σ.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..geometry import Array, se3
from ..geometry.linear import symmetric
from ..motion import Motion
from .settings import SETTINGS


class OwnAndCommon(NamedTuple):
    """The factors by which σ is too small: `own` of each motion's own errors, `common` of the errors c of the rig.

    Both are None if they cannot be told apart or there are no common errors; `shown`: how many of the latter the
    motions show, in effect.
    """

    own: float | None
    common: float | None
    shown: float


def own_and_common(motions: Sequence[Motion], true: Array, cov_true: Array, alike: float) -> OwnAndCommon:
    """Return both factors of motions with the errors of one rig, against the truth (n, 4, 4) with `cov_true` (6, 6).

    `alike`: how many successive motions share their frames, and so their own errors.
    """
    last = motions[-1]
    given = [m.given(last.mean, last.cov_common) for m in motions]
    error = se3.log(se3.inverse(np.stack([m.earlier_from_newest for m in given])) @ true)
    root = np.linalg.cholesky(symmetric(np.stack([m.cov_own for m in given])) + cov_true)
    by_c = np.stack([m.common_jacobian for m in given]) @ _root(last.cov_common)  # c in units of its σ
    whitened, by_c = np.linalg.solve(root, error[..., None])[..., 0], np.linalg.solve(root, by_c)
    information = np.einsum("nij,nik->jk", by_c, by_c) / alike
    weighted = np.einsum("nij,ni->j", by_c, whitened) / alike
    variance, values, eye = 1.0, float(whitened.size), np.eye(len(information))
    c, shown = np.zeros(len(eye)), 0.0
    for _ in range(SETTINGS.own_fits if len(eye) else 1):
        c = np.linalg.solve(information / variance + eye, weighted / variance)
        shown = float(np.trace(np.linalg.solve(information / variance + eye, information / variance)))
        if 2 * alike * shown > values:
            return OwnAndCommon(None, None, shown)
        variance = float(((whitened - by_c @ c) ** 2).sum()) / (values - alike * shown)
    common = float(np.sqrt(c @ c / shown)) if shown > 0 else None
    return OwnAndCommon(float(np.sqrt(variance)), common, shown)


def common_apart(one: Motion, other: Motion) -> float | None:
    """Return the distance of the common errors that two halves of the same views found, over its σ; None without any.

    Both started from the same N(0, I), so their errors are correlated by C̄_a C̄_b.
    """
    if not len(one.mean) or one.mean.shape != other.mean.shape:
        return None
    both = one.cov_common @ other.cov_common
    values, vectors = np.linalg.eigh(symmetric(one.cov_common + other.cov_common - both - both.T))
    known = values > SETTINGS.least_eigenvalue
    apart = vectors[:, known].T @ (one.mean - other.mean)
    return float(np.sqrt(np.mean(apart**2 / values[known]))) if known.any() else None


def _root(cov: Array) -> Array:
    """Return a root (m, m) of a covariance that may be singular."""
    values, vectors = np.linalg.eigh(symmetric(cov))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
