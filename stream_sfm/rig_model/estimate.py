"""What a run has found out about its rig's errors: numbers, and the sentences that they make."""

from typing import NamedTuple

import numpy as np

from ..camera.refinement import LENS_TERMS, Refinement
from ..geometry import Array
from ..record import record
from .terms import CAUSES, TERMS, Group, at

CERTAIN = 5.0  # standard deviations from which on an error is put into words, and known to change


def is_certain(error: Array, cov: Array) -> bool:
    """Whether an error (k,) with covariance (k, k) is certain not to be zero."""
    return bool(error @ np.linalg.pinv(cov) @ error > CERTAIN**2)


def in_words(error: Array, cov: Array, per_unit: float, sentence: str, words: tuple[str, str]) -> str:
    """Return a sentence with the size of an error (k,) and its σ, and the word for its sign; see `terms.Group`."""
    size = float(np.linalg.norm(error))
    std = float(np.sqrt(error @ cov @ error)) / size
    return sentence.format(per_unit * size, per_unit * std, words[0] if error[0] > 0 else words[1])


class Amplitudes(NamedTuple):
    """What is known of the errors: N(`mean` (m,), `cov` (m, m)) in σ of each, which have grown for `age_s`."""

    mean: Array
    cov: Array
    age_s: float = 0.0


@record
class RigEstimate:
    """What is known about the errors of the rig: `mean` (m,) with covariance `cov` (m, m), taken out of all views.

    Both are those of a mixture: with the probability `p_wrong` the calibration has errors, N(`mean_if_wrong`,
    `cov_if_wrong`), otherwise it has none. Of a Solution in σ of what was assumed beforehand, of a FrameEstimate in the
    units of `stream_sfm.rig_model.terms`. `prior_std` (m,): σ of each before any view, as far as has been learnt.
    `refined` (m,): the part of `mean` that a refinement of the calibration has already; None without one. `age_s`:
    for how long errors have grown by their rates; those of a Solution are of the start, of a FrameEstimate of now.
    `evidence` (t,): on how many σ thirds of the run agree for each term; None while it is too short to have thirds.
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

    @property
    def applied(self) -> bool:
        """Whether the calibration is more probably wrong than right."""
        return self.p_wrong > 0.5

    @property
    def refinement(self) -> Refinement:
        """The errors of lenses and disparity, px, if there are any."""
        n = len(LENS_TERMS)
        return Refinement(self.mean_if_wrong[:n], self.cov_if_wrong[:n, :n])

    def term(self, name: str) -> tuple[float, float]:
        """Return one of the `TERMS` in its unit, and its standard deviation."""
        where = TERMS.index(name)
        return float(self.mean[where]), float(np.sqrt(self.cov[where, where]))

    def group(self, group: Group) -> tuple[float, ...]:
        """Return the errors of a group, and then their standard deviations."""
        errors, std = zip(*(self.term(name) for name in group.terms), strict=True)
        return *errors, *std

    def agrees(self, terms: tuple[str, ...]) -> bool:
        """Whether thirds of the run agree about one of some terms that follow each other."""
        return self.evidence is not None and float(self.evidence[at(terms)].max()) > CERTAIN

    def findings(self) -> list[str]:
        """Sentences about what is certain of the cameras' timing and focal length, of an estimate in units.

        That is where all of the run says so, and its thirds agree about it.
        """
        found = []
        for group in CAUSES:
            where = at(group.terms)
            error, cov = self.mean[where], self.cov[where, where]
            if self.agrees(group.terms) and is_certain(error, cov):
                found.append(in_words(error, cov, group.per_unit, group.sentence, group.words))
        return found

    def __repr__(self) -> str:
        return f"<RigEstimate {len(self.mean)} terms, wrong with probability {self.p_wrong:.2g}>"
