"""Detection of a changing focal length in its first frame, and its estimate per frame until it rests, eq. (72l).

A zoom scales the whole image about its centre, and the disparities with it. If points lie at various depths, no motion
does that. Once frames together show a change, the focal length of each frame is an unknown of its own.
Once it has been constant for some frames, or frames show that there is no change, it is one of the rig's errors again.
An image that is not scaled about its principal point is shifted as well, as by a rotation of the camera; so the
uncertainty of the pose grows with the change of the focal length.
"""

import math
from collections.abc import Sequence

import numpy as np

from ....config import RigConfig
from ....geometry import Array
from ....geometry.evidence import Evidence
from ....geometry.sizes import Sizes, Weighed
from ....record import changed, record
from .focal_change import Calm, Change, log_normal


@record
class FocusWatch:
    """Relative changes of the focal length that frames show.

    `change`: what a change would be, with its `evidence`; `calm`: what frames show without one, None before the first
    frame. `shown`: while the focal length changes, the change that each of the latest frames has shown, with its
    variance. `rested`: its total change in the past.
    """

    rules: RigConfig
    evidence: Evidence
    change: Change = Change()
    calm: Calm | None = None
    shown: tuple[tuple[float, float], ...] = ()
    rested: float = 0.0

    @classmethod
    def begun(cls, rules: RigConfig) -> "FocusWatch":
        """Return the watch of a new map."""
        return cls(rules, Evidence(rules.refocused, rules.innovations))

    @property
    def moves(self) -> bool:
        """Whether the focal length changes."""
        return bool(self.shown)

    @property
    def has_begun(self) -> bool:
        """Whether the latest frame is the first that shows the change."""
        return len(self.shown) == 1

    def after(self, frame: Weighed, sizes: Sequence[Sizes]) -> tuple["FocusWatch", Array]:
        """Return the watch after a frame, and the log likelihoods (g,) of the frame for each combination of sizes.

        `frame`: what it shows of a change of the focal length by `rules.std_refocused`, with each combination of the
        `sizes` of its other unknowns. The first frame after a start shows the errors of the calibration as well.
        """
        shown, var = frame.weighted / frame.information, 1 / frame.information
        likely = frame.log + 0.5 * (shown**2 / var + np.log(var))
        if self.calm is None:
            likely = likely + log_normal(shown, var + 1)
            return changed(self, calm=Calm(self.rules.calm_frames)), likely
        calm = likely + self.calm.log_of(shown, var)
        change = likely + np.logaddexp.reduce(self.change.log_of(shown, self.calm.factor * var), axis=-1)
        nats = frame.total(sizes, change) - frame.total(sizes, calm)
        odds = self.evidence.after(nats).log_odds
        likely = np.logaddexp(calm - np.logaddexp(0, odds), change - np.logaddexp(0, -odds))
        row = frame.row_of(frame.sizes(sizes, likely))
        return self._after(float(shown[row]), float(var[row]), nats), likely

    def _after(self, shown: float, var: float, nats: float) -> "FocusWatch":
        """Return the watch after a frame that shows an amount, and is so much evidence for a change.

        A change begins where it begins: as long as there is no evidence for it, it starts from what calm frames show.
        """
        rules, calm = self.rules, self.calm
        if calm is None or abs(shown - (self.change.at if self.moves else 0.0)) > rules.most_refocused:
            return self.at_rest()  # a body, not a zoom
        evidence = self.evidence.after(nats)
        change = self.change.after(shown, calm.factor * var)
        if not evidence.is_there and evidence.change == 0.0:
            change = Change(calm.mean)
        # what may be a change is not usual
        learns = 0.0 if evidence.is_there else 1 / (1 + math.exp(evidence.change - evidence.bound / 4))
        calm = calm.learnt(shown, var, learns, rules.innovations)
        watch = changed(self, evidence=evidence, change=change, calm=calm)
        if not evidence.is_there:
            return watch.at_rest() if self.moves else watch
        unit = rules.std_refocused
        return changed(watch, shown=(*self.shown[-rules.rested_frames :], (unit * shown, unit**2 * var)))

    @property
    def rests_at(self) -> float | None:
        """The change of the focal length that the latest frames agree on; None if it varies or frames are few."""
        n, rests = self.rules.rested_frames, self.rules.rests
        if len(self.shown) < n:
            return None
        shares, var = np.array(self.shown[-n:]).T
        weight = 1 / (var * (1.0 if self.calm is None else self.calm.factor))
        mean = float(weight @ shares / weight.sum())
        since = np.arange(n) - weight @ np.arange(n) / weight.sum()
        slope, scatter = float(weight * since @ shares), float(weight @ (shares - mean) ** 2)
        even = slope**2 < rests**2 * float(weight @ since**2)
        return mean if even and scatter < n + rests * np.sqrt(2 * n) else None

    @property
    def cov_axes(self) -> Array:
        """The covariance (6, 6) that the change of the focal length so far adds to the newest pose."""
        share = self.rested + (self.shown[-1][0] if self.moves else 0.0)
        return np.diag([0, 0, 0, 1, 1, 0]) * (self.rules.refocused_axes_rad * share) ** 2

    def at_rest(self, share: float = 0.0) -> "FocusWatch":
        """Return the watch once the focal length rests, after a relative change by `share`."""
        evidence = changed(self.evidence, is_there=False, change=0.0)
        return changed(self, evidence=evidence, change=Change(), shown=(), rested=self.rested + share)
