"""Known errors of a stereo calibration: a smooth field of disparity, the lenses, and the timing.

A calibration with a refinement is used like any other: views are corrected by it before any estimator sees them, and
its remaining uncertainty is taken into account. docs/mathematics.md, section 13.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ..errors import ConfigError
from ..geometry import Array
from ..record import record, settle
from .settings import SETTINGS

# Six terms of the disparity, with x and y from the middle of the image in half widths and half heights. Then errors
# that both lenses share, in pixels at the distance of the corner: radial of third and fifth order, principal point,
# tangential. Last, the radial errors of the right lens minus those of the left one.
LENS_TERMS = (
    *("1", "x", "y", "xx", "xy", "yy"),
    *("radial 3", "radial 5", "centre x", "centre y", "tangential x", "tangential y", "radial difference"),
)

DISPARITY, LENSES, DIFFERENCE = slice(0, 6), slice(6, 12), slice(12, 13)
PARTS = (DISPARITY, LENSES, DIFFERENCE)  # one motion may show one of them, and not the others


@record
class Refinement:
    """Errors `error_px` (m,) of a calibration, by the m `LENS_TERMS`, with covariance `cov_px2` (m, m).

    Raises ConfigError for invalid errors or covariances.
    """

    error_px: Array
    cov_px2: Array

    def __post_init__(self) -> None:
        n = len(LENS_TERMS)
        error, cov = np.array(self.error_px, dtype=float), np.array(self.cov_px2, dtype=float)
        if error.shape != (n,) or cov.shape != (n, n) or not np.isfinite(error).all():
            raise ConfigError(f"a refinement has {n} errors and their {n}×{n} covariance, all of them finite")
        try:
            np.linalg.cholesky(cov)
        except np.linalg.LinAlgError:
            raise ConfigError("the covariance of a refinement is not positive definite") from None
        settle(self, "error_px", error)
        settle(self, "cov_px2", cov)

    @property
    def std_px(self) -> Array:
        """The standard deviation (m,) of each error."""
        return np.sqrt(np.diag(self.cov_px2))

    def only(self, parts: Sequence[slice], prior_std_px: Array) -> "Refinement":
        """Return the refinement with some of the `PARTS`; the others are unknown, with σ `prior_std_px` (m,)."""
        kept = np.zeros(len(LENS_TERMS), dtype=bool)
        for part in parts:
            kept[part] = True
        cov = np.where(np.outer(kept, kept), self.cov_px2, 0.0) + np.diag(np.where(kept, 0.0, prior_std_px**2))
        return Refinement(np.where(kept, self.error_px, 0.0), cov)

    def __repr__(self) -> str:
        return f"<Refinement {disparity_rms_px(self.error_px):.2f} px of disparity>"


@dataclass(frozen=True, slots=True)
class KnownTiming:
    """Delay of the right camera, and readout time of both shutters from the top down; each with its σ, in seconds.

    Raises ConfigError for values that are not finite, and for a σ that is not positive.
    """

    delay_s: float
    std_delay_s: float
    readout_s: float
    std_readout_s: float

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = getattr(self, name)
            if not -1 <= value <= 1:  # larger values are milliseconds given as seconds
                raise ConfigError(f"{name} is {value!r}: give seconds, at most 1")
            if name.startswith("std") and value <= 0:
                raise ConfigError(f"{name} is {value!r}: give a σ above 0")

    @property
    def mean(self) -> Array:
        """Values of delay and readout (2,)."""
        return np.array([self.delay_s, self.readout_s])

    @property
    def std(self) -> Array:
        """Their σ (2,)."""
        return np.array([self.std_delay_s, self.std_readout_s])


def combine(refinements: Sequence[Refinement], priors_std_px: Array, prior_std_px: Array) -> Refinement:
    """Return the errors of a further log, given those of n logs of one rig, eq. (72n).

    The runs had priors of σ `priors_std_px` (n, m) about zero; the usual ones are `prior_std_px` (m,). Logs differ by
    N(0, diag(τ²)) from an error that they share. τ² follows from their scatter by variational Bayes, with a prior
    about `SETTINGS.logs_differ`, and is part of the result's covariance.
    """
    logs = [_by_views(*log) for log in zip(refinements, priors_std_px, strict=True)]
    factor = np.where(np.arange(len(prior_std_px)) < DISPARITY.stop, SETTINGS.common_disparity, 1.0)
    var_shared = (factor * prior_std_px) ** 2
    guess = (SETTINGS.logs_differ * prior_std_px) ** 2
    tau2 = spread = guess.copy()
    for _ in range(SETTINGS.rounds):
        found = [np.linalg.solve(np.eye(len(tau2)) + of * tau2, np.c_[of, sums]) for of, sums in logs]
        cov = np.linalg.inv(np.diag(1 / var_shared) + sum(each[:, :-1] for each in found))
        shared = cov @ sum(each[:, -1] for each in found)
        if len(logs) == 1:  # nothing shows τ
            break
        squares = SETTINGS.logs_weight * guess
        for each in found:  # mean square of an error of this log, beyond the shared one
            by, own = tau2[:, None] * each[:, :-1], tau2 * (each[:, -1] - each[:, :-1] @ shared)
            squares = squares + own**2 + tau2 - np.diag(by) * tau2 + np.einsum("ij,jk,ik->i", by, cov, by)
        degrees = len(logs) + SETTINGS.logs_weight
        tau2, spread = squares / degrees, squares / (degrees - 2)  # inverse gamma: 1/E[1/τ²], E[τ²]
    cov = cov + np.diag(spread)
    return Refinement(shared, 0.5 * (cov + cov.T))


def _by_views(refinement: Refinement, prior_std_px: Array) -> tuple[Array, Array]:
    """Return information (m, m) and weighted sums (m,) about the errors by the views of a run, without its prior."""
    information = np.linalg.inv(refinement.cov_px2)
    values, axes = np.linalg.eigh(information - np.diag(prior_std_px**-2.0))
    return axes * np.maximum(values, 0.0) @ axes.T, information @ refinement.error_px


def disparity_rms_px(error_px: Array) -> float:
    """Return the root mean square disparity error over the image, without the lens terms."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21)))
    field = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1) @ error_px[:6]
    return float(np.sqrt((field**2).mean()))
