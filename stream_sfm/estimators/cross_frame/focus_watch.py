"""A focal length that changes: noticed in its first frame, and followed until it rests.

A zoom scales all of an image about its middle, and with it the disparities. Where points lie at various depths no
motion does that, so each frame shows by how much its focal length is another one than that of the points: to a
hundredth of a percent on good images. Where that is more than usual, the focal length of each frame is an unknown of
its own from then on. So it may do what it wants, the pose is as uncertain as that makes it, and no frame suffers from
another. Once it has been the same for some frames, it is one of the rig's errors again.

What is not scaled about its principal point is moved as well. That looks like a turn of the camera, and no view tells
them apart; so the pose is as uncertain as the way of the focal length makes it.
"""

import numpy as np

from ...config import RigConfig
from ...geometry import Array
from ...geometry.point_views import PointViews
from ...geometry.resection import Resection, refine
from ...record import changed, record


@record
class FocusWatch:
    """What frames show of their focal lengths, as shares of it.

    `spread`: mean square of what calm frames show, in σ of that, over the last of `frames`, and `waiting`: those of the
    latest. `shown`: while it changes, what each of the latest frames has shown of it, with its variance. `rested`: by
    how much it has changed before.
    """

    rules: RigConfig
    spread: float = 1.0
    frames: int = 0
    shown: tuple[tuple[float, float], ...] = ()
    waiting: tuple[float, ...] = ()
    rested: float = 0.0

    @classmethod
    def begun(cls, rules: RigConfig) -> "FocusWatch":
        """Return the watch of a map that begins."""
        return cls(rules, frames=rules.calm_frames)

    @property
    def moves(self) -> bool:
        """Whether the focal length changes."""
        return bool(self.shown)

    @property
    def has_begun(self) -> bool:
        """Whether the latest frame is the first that shows it."""
        return len(self.shown) == 1

    def judge(self, views: PointViews, weights: Array, found: Resection) -> tuple["FocusWatch", Resection]:
        """Return the watch after a frame, and its motion, with a focal length of its own where that changes.

        The last of the errors that `views` share is a change of it by `rules.std_refocused`; it is the last of the
        motion's amplitudes. `found` is the motion without it, with `weights` (n,) as in `resect`.
        """
        start, unit = np.append(found.amplitudes, 0.0), self.rules.std_refocused
        own = refine(views, weights, found.cam_from_ref, start)
        if not own.ok or (not self.moves and own.accepted.sum() < found.accepted.sum()):
            return self, changed(found, amplitudes=start)
        explained = own.share >= views.settings.calm_share  # by one motion, where two seemed to be
        own = changed(own, second=None if explained else found.second)
        var = float(own.cov_amplitudes[-1, -1])
        information = max(1 / var - 1, 1e-9)  # without that of σ = 1
        shown = unit * float(own.amplitudes[-1]) / (var * information), unit**2 / information
        before = self.shown[-1][0] if self.moves else 0.0
        if abs(shown[0] - before) > self.rules.most_refocused * unit:  # a body that moves, and no zoom
            return self.calm(), changed(found, amplitudes=start)
        if self.moves:
            return changed(self, shown=(*self.shown[-self.rules.rested_frames :], shown)), own
        square = shown[0] ** 2 / shown[1]
        # the first frame after a start shows as well what the calibration has wrong
        if self.waiting and square > self.rules.refocused**2 * max(self.spread, 1.0):
            return changed(self, shown=(shown,), waiting=()), own
        return self._learnt(square), found

    def _learnt(self, square: float) -> "FocusWatch":
        """Return the watch after a calm frame, which shows what is usual once as many more have been calm.

        What grows from frame to frame until it stands out would be usual by then.
        """
        waiting = (*self.waiting, square)
        if len(waiting) <= self.rules.rested_frames:
            return changed(self, waiting=waiting)
        frames = min(self.frames + 1, self.rules.innovations)
        spread = self.spread + (waiting[0] - self.spread) / frames
        return changed(self, spread=spread, frames=frames, waiting=waiting[1:])

    @property
    def rests_at(self) -> float | None:
        """The change of the focal length that the latest frames have in common, once there are enough."""
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
        """What the change of the focal length so far adds to the covariance (6, 6) of the newest pose."""
        share = self.rested + (self.shown[-1][0] if self.moves else 0.0)
        return np.diag([0, 0, 0, 1, 1, 0]) * (self.rules.refocused_axes_rad * share) ** 2

    def calm(self, share: float = 0.0) -> "FocusWatch":
        """Return the watch of a focal length that rests, after it has changed by such a share."""
        return changed(self, shown=(), rested=self.rested + share)
