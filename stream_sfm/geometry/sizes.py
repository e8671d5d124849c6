"""How large the errors of a frame are compared with those assumed: a hidden Markov chain of a few sizes, eq. (7b)."""

from dataclasses import field

import numpy as np

from .. import core
from ..record import changed, record
from .se3 import Array

# Multiples of the assumed σ. With factors of 2 instead of 4 most frames of a motorway drive count as larger than they
# are: it errs by 89 mm instead of 32.
SIZES: Array = 4.0 ** np.arange(4.0)
# Of a size before any frame, and of one that is drawn anew: a single frame may be far off.
_DRAWN = np.array([0.9, 0.07, 0.02, 0.01])
_DRAWN_ANEW = 0.05  # probability per frame: a rig shakes for about a second at a time


@record
class Sizes:
    """The `probabilities` (k,) of `SIZES` in the latest frame. A size stays, or is drawn anew."""

    probabilities: Array = field(default_factory=lambda: _DRAWN)

    @property
    def log_prior(self) -> Array:
        """The log probabilities (k,) in the next frame, before it is seen."""
        return np.asarray(np.log((1 - _DRAWN_ANEW) * self.probabilities + _DRAWN_ANEW * _DRAWN))

    def after(self, log_likelihoods: Array) -> "Sizes":
        """Return the sizes after a frame with these log likelihoods (k,) of each size."""
        posterior = self.log_prior + log_likelihoods
        weights = np.exp(posterior - posterior.max())
        return changed(self, probabilities=weights / weights.sum())

    def after_amplitudes(self, mean: Array, cov: Array) -> "Sizes":
        """Return the sizes after a frame that shows amplitudes (e,) with `cov` (e, e), if size 1 was assumed."""
        if not len(mean):
            return self
        weighted = np.linalg.solve(cov, mean)
        values, axes = np.linalg.eigh(np.linalg.inv(cov) - np.eye(len(mean)))
        evidence = core.log_evidence(np.maximum(values, 0.0), axes.T @ weighted, SIZES**2)
        return self.after(evidence.sum(axis=1))

    @property
    def probable(self) -> float:
        """The most probable size."""
        return float(SIZES[self.probabilities.argmax()])
