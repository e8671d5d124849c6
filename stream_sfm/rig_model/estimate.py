"""What a run has found out about its rig's errors: numbers, and the sentences that they make."""

import numpy as np

from ..camera.refinement import TERMS as LENS_TERMS
from ..camera.refinement import Refinement
from ..geometry.se3 import Array
from ..record import record
from .terms import AT_TURNING, DELAY, FOCAL, FOCUSING, READOUT, TERMS

CERTAIN = 5.0  # standard deviations from which on an error is put into words, and known to change


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
        delay, readout, focal = (self.term(name) for name in (DELAY, READOUT, FOCAL))
        found = []
        if abs(delay[0]) > CERTAIN * delay[1]:
            when = "late" if delay[0] > 0 else "early"
            found.append(f"the right camera is {1e3 * abs(delay[0]):.2f} ± {1e3 * delay[1]:.2f} ms {when}")
        if abs(readout[0]) > CERTAIN * readout[1]:
            way = "" if readout[0] > 0 else ", from the bottom up"
            found.append(f"the shutters read out in {1e3 * abs(readout[0]):.2f} ± {1e3 * readout[1]:.2f} ms{way}")
        if abs(focal[0]) > CERTAIN * focal[1]:
            longer = "longer" if focal[0] > 0 else "shorter"
            found.append(f"the focal length is {100 * abs(focal[0]):.2f} ± {100 * focal[1]:.2f} % {longer}")
        focusing = self.term(FOCUSING)
        if abs(focusing[0]) > CERTAIN * focusing[1]:
            grows = "grows" if focusing[0] > 0 else "shrinks"
            found.append(
                f"the focal length {grows} by {100 * abs(focusing[0]):.3f} ± {100 * focusing[1]:.3f} % per second"
            )
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
