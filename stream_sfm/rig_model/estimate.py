"""What a run has found out about its rig's errors: numbers, and the sentences that they make."""

import numpy as np

from ..camera.refinement import TERMS as LENS_TERMS
from ..camera.refinement import Refinement
from ..geometry.se3 import Array
from ..record import record
from .terms import AT_TURNING, DELAY, FOCAL, FOCUSING, READOUT, TERMS

CERTAIN = 5.0  # standard deviations from which on an error is put into words, and known to change
# Of each term: units per its own unit; what is said of it; and the word where it is positive, and negative.
_SENTENCES = {
    DELAY: (1e3, "the right camera is {:.2f} ± {:.2f} ms {}", "late", "early"),
    READOUT: (1e3, "the shutters read out in {:.2f} ± {:.2f} ms{}", "", ", from the bottom up"),
    FOCAL: (100, "the focal length is {:.2f} ± {:.2f} % {}", "longer", "shorter"),
    FOCUSING: (100, "the focal length {2} by {0:.3f} ± {1:.3f} % per second", "grows", "shrinks"),
}


@record
class RigEstimate:
    """What is known about the errors of the rig: `mean` (m,) with covariance `cov` (m, m), taken out of all views.

    Both are those of a mixture: with the probability `p_wrong` the calibration has errors, N(`mean_if_wrong`,
    `cov_if_wrong`), otherwise it has none. Of a Solution in σ of what was assumed beforehand, of a FrameEstimate in the
    units of `stream_sfm.rig_model.terms`. `prior_std` (m,): σ of each before any view, as far as has been learnt.
    `refined` (m,): the part of `mean` that a refinement of the calibration has already; None without one. `age_s`:
    for how long errors have grown by their rates; those of a Solution are of the start, of a FrameEstimate of now.
    """

    mean: Array
    cov: Array
    p_wrong: float
    mean_if_wrong: Array
    cov_if_wrong: Array
    prior_std: Array
    refined: Array | None = None
    age_s: float = 0.0

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
        at = TERMS.index(name)
        return float(self.mean[at]), float(np.sqrt(self.cov[at, at]))

    def findings(self) -> list[str]:
        """Sentences about what is certain of the cameras' timing and focal length, of an estimate in units."""
        found = []
        for term, (units, sentence, positive, negative) in _SENTENCES.items():
            error, std = self.term(term)
            if abs(error) > CERTAIN * std:
                word = positive if error > 0 else negative
                found.append(sentence.format(units * abs(error), units * std, word))
        rate, cov = self.mean[AT_TURNING], self.cov[AT_TURNING, AT_TURNING]
        if rate @ np.linalg.solve(cov, rate) > CERTAIN**2:
            size = float(np.linalg.norm(rate))
            std = float(np.sqrt(rate @ cov @ rate)) / size
            found.append(
                f"the right camera turns against the left one by {6e4 * size:.2f} ± {6e4 * std:.2f} mrad per minute"
            )
        return found

    def __repr__(self) -> str:
        return f"<RigEstimate {len(self.mean)} terms, wrong with probability {self.p_wrong:.2g}>"
