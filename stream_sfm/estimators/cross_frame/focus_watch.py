"""Detection of a changing focal length in its first frame, and its estimate per frame until it rests.

A zoom scales the whole image about its centre, and the disparities with it. If points lie at various depths, no motion
does that. So each frame shows how much its focal length differs from that of the points, to a hundredth of a percent on
good images. Once the difference is larger than usual, the focal length of each frame is an unknown of its own. It may
then change in any way: the pose becomes as uncertain as that makes it, and frames do not affect each other. Once it has
been constant for some frames, it is one of the rig's errors again.

An image that is not scaled exactly about its principal point is shifted as well. That looks like a rotation of the
camera, and no view can tell them apart; so the uncertainty of the pose grows with the change of the focal length.
"""

import numpy as np

from ...config import RigConfig
from ...geometry import Array
from ...geometry.point_views import PointViews
from ...geometry.resection import Resection, refine
from ...record import changed, record


@record
class FocusWatch:
    """Relative changes of the focal length that frames show.

    `spread`: mean square of the change that calm frames show, in its σ, over the last `frames`; `waiting`: the squares
    of the latest frames, which are not in it yet. `shown`: while the focal length changes, the change that each of the
    latest frames has shown, with its variance. `rested`: its total change in the past.
    """

    rules: RigConfig
    spread: float = 1.0
    frames: int = 0
    shown: tuple[tuple[float, float], ...] = ()
    waiting: tuple[float, ...] = ()
    rested: float = 0.0

    @classmethod
    def begun(cls, rules: RigConfig) -> "FocusWatch":
        """Return the watch of a new map."""
        return cls(rules, frames=rules.calm_frames)

    @property
    def moves(self) -> bool:
        """Whether the focal length changes."""
        return bool(self.shown)

    @property
    def has_begun(self) -> bool:
        """Whether the latest frame is the first that shows the change."""
        return len(self.shown) == 1

    def judge(
        self, views: PointViews, weights: Array, found: Resection, tells: bool = True
    ) -> tuple["FocusWatch", Resection]:
        """Return the watch after a frame, and its motion, with a focal length of its own while that changes.

        The last of the errors that `views` share is a change of the focal length by `rules.std_refocused`; the last of
        the motion's amplitudes belongs to it. `found` is the motion without it, with `weights` (n,) as in `resect`.

        Unless the frame `tells`, it cannot show a zoom: its views are shifted by a velocity that is not known yet,
        through the readout or the delay.
        """
        start, unit = np.append(found.amplitudes, 0.0), self.rules.std_refocused
        own = refine(views, weights, found.cam_from_ref, start)
        if not own.ok or (not self.moves and own.accepted.sum() < found.accepted.sum()):
            return self, changed(found, amplitudes=start)
        explained = own.share >= views.settings.calm_share  # by one motion, where two seemed to be
        own = changed(own, second=None if explained else found.second)
        var = float(own.cov_amplitudes[-1, -1])
        information = max(1 / var - 1, 1e-9)  # without the prior of σ = 1
        shown = unit * float(own.amplitudes[-1]) / (var * information), unit**2 / information
        before = self.shown[-1][0] if self.moves else 0.0
        if abs(shown[0] - before) > self.rules.most_refocused * unit:  # a moving body, not a zoom
            return self.calm(), changed(found, amplitudes=start)
        if not tells:
            return self.calm() if self.moves else self._learnt(shown[0] ** 2 / shown[1]), found
        if self.moves:
            return changed(self, shown=(*self.shown[-self.rules.rested_frames :], shown)), own
        square = shown[0] ** 2 / shown[1]
        # the first frame after a start also shows the errors of the calibration
        if self.waiting and square > self.rules.refocused**2 * max(self.spread, 1.0):
            return changed(self, shown=(shown,), waiting=()), own
        return self._learnt(square), found

    def _learnt(self, square: float) -> "FocusWatch":
        """Return the watch after a calm frame; it counts in `spread` only after `rested_frames` more calm frames.

        Otherwise a slow change would pass as usual before it becomes visible.
        """
        waiting = (*self.waiting, square)
        if len(waiting) <= self.rules.rested_frames:
            return changed(self, waiting=waiting)
        frames = min(self.frames + 1, self.rules.innovations)
        spread = self.spread + (waiting[0] - self.spread) / frames
        return changed(self, spread=spread, frames=frames, waiting=waiting[1:])

    @property
    def rests_at(self) -> float | None:
        """The change of the focal length that the latest frames agree on; None if it is not constant or frames are
        few."""
        n, rests = self.rules.rested_frames, self.rules.rests
        if len(self.shown) < n:
            return None
        shares, var = np.array(self.shown[-n:]).T
        weight = 1 / (var * max(self.spread, 1.0))
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

    def calm(self, share: float = 0.0) -> "FocusWatch":
        """Return the watch once the focal length rests, after a relative change by `share`."""
        return changed(self, shown=(), rested=self.rested + share)
