"""Detection of a changing focal length in its first frame, and its estimate per frame until it rests.

A zoom scales the whole image about its centre, and the disparities with it. If points lie at various depths, no motion
does that. So each frame shows how much its focal length differs from that of the points, to a hundredth of a percent on
good images. Once frames together show a change, the focal length of each frame is an unknown of its own. It may then
change in any way: the pose becomes as uncertain as that makes it, and frames do not affect each other. Once it has been
constant for some frames, or frames show that there is no change, it is one of the rig's errors again.

An image that is not scaled exactly about its principal point is shifted as well. That looks like a rotation of the
camera, and no view can tell them apart; so the uncertainty of the pose grows with the change of the focal length.
"""

import math

import numpy as np

from ....config import RigConfig
from ....geometry import Array
from ....geometry.evidence import Evidence
from ....geometry.point_views import PointViews
from ....geometry.resection import Resection, refine
from ....record import changed, record
from .focal_change import Calm, Change, log_ratio


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

    def judge(
        self, views: PointViews, weights: Array, found: Resection, informative: bool = True
    ) -> tuple["FocusWatch", Resection]:
        """Return the watch after a frame, and its motion, with a focal length of its own while that changes.

        The last of the errors that `views` share is a change of the focal length by `rules.std_refocused`; the last of
        the motion's amplitudes belongs to it. `found` is the motion without it, with `weights` (n,) as in `resect`.
        Unless the frame is `informative`, it is no evidence: its views move by a velocity that is not known yet,
        through readout or delay.
        """
        start = np.append(found.amplitudes, 0.0)
        calm, own = changed(found, amplitudes=start), refine(views, weights, found.cam_from_ref, start)
        if not own.ok or (not self.moves and own.accepted.sum() < found.accepted.sum()):
            return self, calm
        own = changed(own, second=found.second)
        var = float(own.cov_amplitudes[-1, -1])
        information = max(1 / var - 1, 1e-9)  # without the prior of σ = 1
        shown, var = float(own.amplitudes[-1]) / (var * information), 1 / information
        if abs(shown - (self.change.at if self.moves else 0.0)) > self.rules.most_refocused:  # a body, not a zoom
            return self.at_rest(), calm
        watch = self._after(shown, var) if informative else self
        if not watch.evidence.is_there:
            return watch.at_rest() if self.moves else watch, calm
        unit = self.rules.std_refocused
        return changed(watch, shown=(*self.shown[-self.rules.rested_frames :], (unit * shown, unit**2 * var))), own

    def _after(self, shown: float, var: float) -> "FocusWatch":
        """Return the watch with the evidence of a frame.

        The first frame after a start shows the errors of the calibration as well. A change begins where it begins: as
        long as there is no evidence for it, it starts from what calm frames show.
        """
        rules = self.rules
        if self.calm is None:
            return changed(self, calm=Calm(rules.calm_frames))
        evidence = self.evidence.after(log_ratio(self.change, self.calm, shown, var))
        change = self.change.after(shown, self.calm.factor * var)
        if not evidence.is_there and evidence.change == 0.0:
            change = Change(self.calm.mean)
        # what may be a change is not usual
        learns = 0.0 if evidence.is_there else 1 / (1 + math.exp(evidence.change - evidence.bound / 4))
        calm = self.calm.learnt(shown, var, learns, rules.innovations)
        return changed(self, evidence=evidence, change=change, calm=calm)

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
