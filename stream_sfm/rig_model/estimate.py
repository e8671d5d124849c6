"""The rig errors that a run has found, in numbers and in sentences."""

from typing import NamedTuple

import numpy as np

from ..camera.refinement import LENS_TERMS, Refinement
from ..geometry import Array
from ..record import record
from .terms import CAUSES, TERMS, Group, at

CERTAIN = 5.0  # standard deviations from which an error is reported in words, and known to change


def is_certain(error: Array, cov: Array) -> bool:
    """Whether an error (k,) with covariance (k, k) is certainly not zero."""
    return bool(error @ np.linalg.pinv(cov) @ error > CERTAIN**2)


def in_words(error: Array, cov: Array, per_unit: float, sentence: str, words: tuple[str, str]) -> str:
    """Return a sentence with the size of an error (k,) and its σ, and the word for its sign; see `terms.Group`."""
    size = float(np.linalg.norm(error))
    std = float(np.sqrt(error @ cov @ error)) / size
    return sentence.format(per_unit * size, per_unit * std, words[0] if error[0] > 0 else words[1])


class Amplitudes(NamedTuple):
    """The estimate N(`mean` (m,), `cov` (m, m)) of the errors, each in units of its σ, which have grown for `age_s`."""

    mean: Array
    cov: Array
    age_s: float = 0.0


@record
class RigEstimate:
    """The estimated errors of the rig: `mean` (m,) with covariance `cov` (m, m), for which all views are corrected.

    Both are those of a mixture: with the probability `p_wrong` the calibration has errors, N(`mean_if_wrong`,
    `cov_if_wrong`), otherwise it has none. In a Solution they are in units of the prior σ, in a FrameEstimate in the
    units of `stream_sfm.rig_model.terms`. `prior_std` (m,): learnt σ of each before any view.
    `refined` (m,): the part of `mean` that the calibration already contains, by its refinement or its known timing;
    None without either. `age_s`: the time for which errors have grown by their rates; a Solution has those at the
    start, a FrameEstimate the current ones. `evidence` (t,): the number of σ on which thirds of the run agree for each
    term; `thirds` (3, 2, t): what each says, and its σ. Both are None in a short run.
    """

    mean: Array
    cov: Array
    p_wrong: float
    mean_if_wrong: Array
    cov_if_wrong: Array
    prior_std: Array
    refined: Array | None = None
    age_s: float = 0.0
    evidence: Array | None = None
    thirds: Array | None = None

    @property
    def applied(self) -> bool:
        """Whether the calibration is more probably wrong than right."""
        return self.p_wrong > 0.5

    @property
    def refinement(self) -> Refinement:
        """The errors of lenses and disparity, px, if any."""
        n = len(LENS_TERMS)
        return Refinement(self.mean_if_wrong[:n], self.cov_if_wrong[:n, :n])

    @property
    def further(self) -> Array:
        """The errors (m,) that the calibration does not contain."""
        return self.mean if self.refined is None else self.mean - self.refined

    def term(self, name: str) -> tuple[float, float]:
        """Return one of the `TERMS` in its unit and its standard deviation."""
        where = TERMS.index(name)
        return float(self.mean[where]), float(np.sqrt(self.cov[where, where]))

    def group(self, group: Group) -> tuple[float, ...]:
        """Return the errors of a group, followed by their standard deviations."""
        errors, std = zip(*(self.term(name) for name in group.terms), strict=True)
        return *errors, *std

    def agrees(self, terms: tuple[str, ...]) -> bool:
        """Whether thirds of the run agree about at least one of some consecutive terms."""
        return self.evidence is not None and float(self.evidence[at(terms)].max()) > CERTAIN

    def findings(self) -> list[str]:
        """Return sentences about certain errors of timing and focal length, for an estimate in units.

        An error is certain if the whole run shows it and its thirds agree. Those that the calibration contains are
        left out.
        """
        found = []
        for group in CAUSES:
            where = at(group.terms)
            error, cov = self.further[where], self.cov[where, where]
            if self.agrees(group.terms) and is_certain(error, cov):
                found.append(in_words(error, cov, group.per_unit, group.sentence, group.words))
        return found

    def __repr__(self) -> str:
        return f"<RigEstimate {len(self.mean)} terms, wrong with probability {self.p_wrong:.2g}>"
