"""What is known about the errors of a stereo calibration: a smooth field of disparity, the lenses, and the timing.

A calibration with a refinement is used like any other: views are corrected by it before any estimator sees them, and
what is left of its uncertainty goes on being considered. docs/mathematics.md, section 13.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ..errors import ConfigError
from ..geometry import Array

# Six of the disparity, x and y from the image's middle in half widths and half heights. Then what both lenses share, in
# pixels as far from their middle as the corner: radial of third and of fifth order, principal point, tangential. Last,
# how much more the right lens errs radially than the left one.
LENS_TERMS = (
    *("1", "x", "y", "xx", "xy", "yy"),
    *("radial 3", "radial 5", "centre x", "centre y", "tangential x", "tangential y", "radial difference"),
)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Refinement:
    """Errors `error_px` (m,) of a calibration, by the m `LENS_TERMS`, with covariance `cov_px2` (m, m).

    Raises ConfigError for numbers that are no errors with a covariance.
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
        object.__setattr__(self, "error_px", error)
        object.__setattr__(self, "cov_px2", cov)

    @property
    def std_px(self) -> Array:
        """Standard deviation (m,) of each error."""
        return np.sqrt(np.diag(self.cov_px2))

    def __repr__(self) -> str:
        return f"<Refinement {disparity_rms_px(self.error_px):.2f} px of disparity>"


@dataclass(frozen=True, slots=True)
class KnownTiming:
    """Delay of the right camera, and time in which both shutters read out an image from the top down; each with its σ.

    Seconds. Raises ConfigError for values that are not finite, and for a σ that is not positive.
    """

    delay_s: float
    std_delay_s: float
    readout_s: float
    std_readout_s: float

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = getattr(self, name)
            if not -1 <= value <= 1:  # larger ones are milliseconds given as seconds
                raise ConfigError(f"{name} is {value!r}: give seconds, at most 1")
            if name.startswith("std") and value <= 0:
                raise ConfigError(f"{name} is {value!r}: give the σ of what is known, above 0")

    @property
    def mean(self) -> Array:
        """Delay and readout (2,)."""
        return np.array([self.delay_s, self.readout_s])

    @property
    def std(self) -> Array:
        """Their σ (2,)."""
        return np.array([self.std_delay_s, self.std_readout_s])


def combine(refinements: Sequence[Refinement], priors_std_px: Array, prior_std_px: Array) -> Refinement:
    """The joint refinement of n independent runs that began with errors of `priors_std_px` (n, m) about zero.

    The result has the prior `prior_std_px` (m,) in place of these, which are what each run guessed.
    """
    information, weighted = np.diag(prior_std_px**-2.0), np.zeros(len(prior_std_px))
    for refinement, std_px in zip(refinements, priors_std_px, strict=True):
        own = np.linalg.inv(refinement.cov_px2)
        information += own - np.diag(std_px**-2.0)
        weighted += own @ refinement.error_px
    cov = np.linalg.inv(information)
    return Refinement(cov @ weighted, 0.5 * (cov + cov.T))


def disparity_rms_px(error_px: Array) -> float:
    """Root mean square of the disparity's error over the image, without what the lenses add."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21)))
    field = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1) @ error_px[:6]
    return float(np.sqrt((field**2).mean()))
