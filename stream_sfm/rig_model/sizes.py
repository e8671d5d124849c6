"""The size of a rig's errors by marginal likelihood, and the probability that they are zero.

The joint posterior N(ĉ, C) of the errors under a working prior N(0, diag(s²)) contains the information of all views:
their likelihood is a Gaussian with information Λ = C⁻¹ − diag(s⁻²) and weighted sum η = C⁻¹ĉ. So any other prior can be
compared without using a view again.
"""

from itertools import product

import numpy as np

from .. import core
from ..config import RigConfig
from ..geometry import Array
from ..record import filled, record
from .terms import CAUSES, FOCAL, TERMS

# The candidate sizes, all equally probable: from those of rendered images to three times the assumed ones.
_SIZES = np.geomspace(0.025, 3.0, 41)
_FOCAL = TERMS.index(FOCAL)
# Each of the `CAUSES` is 0 or not; the lenses are a separate case.
_COMBINATIONS = list(product((False, True), repeat=len(CAUSES)))
_IS_ZERO = np.array(  # (32, 7): which terms are 0 in each combination
    [[zero for group, zero in zip(CAUSES, zeros, strict=True) for _ in group.terms] for zeros in _COMBINATIONS]
)
_FOCAL_IS_ZERO = _IS_ZERO[:, 0]
_THERE = np.sum(~np.array(_COMBINATIONS), axis=1)  # the number of causes that are not 0


@record
class Mixture:
    """Errors c as a mixture in which groups may be exactly zero; `p_wrong`: the probability that lenses are not."""

    mean: Array
    cov: Array
    p_wrong: float


def likely_sizes(mean: Array, cov: Array, size: Array) -> Array:
    """Return the most likely size of each physical term, from N(`mean`, `cov`) with the sizes so far, eq. (72a).

    Each term is treated separately, as a readout of 20 ms says nothing about lenses. The focal length keeps its size.
    """
    var = np.diag(cov)[: len(TERMS)]
    information = np.maximum(1 / var - size[: len(TERMS)] ** -2.0, 0.0)
    weighted = mean[: len(TERMS)] / var
    evidence = core.log_evidence(information, weighted, _SIZES**2)
    weight = np.exp(evidence - evidence.max(axis=0))
    result = size.copy()
    result[: len(TERMS)] = np.sqrt(_SIZES**2 @ weight / weight.sum(axis=0))
    result[_FOCAL] = size[_FOCAL]
    return result


def mixture(
    mean: Array,
    cov: Array,
    size: Array,
    rules: RigConfig,
    known_wrong: bool = False,
    spread: float = 1.0,
    refocused: bool = False,
) -> Mixture:
    """Return the errors by N(`mean`, `cov`), where lenses, or each of the other causes, may be zero.

    The field has odds of its own: σ of the rows, which is its size, is an average over a field and none, eq. (19a).
    Noise alone can look like an error of the focal length or a delay while the camera rotates: until one is probable,
    its full σ stays in the covariance. `spread`: the difference of these terms between parts of the run, in σ;
    `refocused`: the focal length is known not to be the calibrated one.
    """
    counts, of_lenses = min(rules.counts, spread**-2.0), rules.counts_of_lenses
    log_prior, alone = np.log(rules.odds) * _THERE, rules.share_alone
    if refocused:
        log_prior[_FOCAL_IS_ZERO] = -np.inf
    found = core.rig_mixture(mean, cov, size, _FOCAL, _IS_ZERO, log_prior, counts, of_lenses, alone, known_wrong)
    return filled(Mixture, found)
