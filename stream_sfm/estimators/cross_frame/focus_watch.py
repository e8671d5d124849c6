"""A focal length that changes: noticed in its first frame, an unknown of each frame until it rests.

A zoom scales all of an image about its middle, and with it the disparities. Where points lie at various depths no
motion does that, so each frame shows by how much its focal length is another one than that of the points, to a hundredth
of a percent on good images. A frame in which that is not as usual begins a suspicion: from then on the focal length of
each frame is one of the frame's own unknowns, eq. (36c), whatever it does. The pose is then as uncertain as that makes
it, and no frame is worse for the one before. Once it is the same for some frames it is one of the rig's errors again.
"""

import numpy as np

from ...config import RigConfig
from ...geometry.point_views import PointViews
from ...geometry.resection import Resection, refine
from ...geometry.se3 import Array
from ...record import changed, record


@record
class FocusWatch:
    """What frames show of their focal lengths, as shares of it.

    `spread`: mean square of what calm frames show, in σ of that, over the last of `frames`. `shown`: while `moves`, what
    each frame since then has shown of it, and its variance.
    """

    rules: RigConfig
    spread: float = 1.0
    frames: int = 0
    moves: bool = False
    shown: tuple[tuple[float, float], ...] = ()

    @classmethod
    def begun(cls, rules: RigConfig) -> "FocusWatch":
        """Return the watch of a map that begins."""
        return cls(rules, frames=rules.calm_frames)

    def judge(self, views: PointViews, weights: Array, found: Resection) -> tuple["FocusWatch", Resection]:
        """Return the watch after a frame, and its motion, with a focal length of its own where that moves.

        The last of what the `views` share is a change of it by `rules.std_refocused`. `weights` (n,) and what was
        `found` without it: as in `resect`.
        """
        start = np.append(found.amplitudes, 0.0)
        own = refine(views, weights, found.cam_from_ref, start)
        if not own.ok or own.accepted.sum() < found.accepted.sum():
            return (self, found) if not self.moves else (self, changed(found, amplitudes=start))
        information = max(1 / own.cov_amplitudes[-1, -1] - 1, 1e-9)
        weighted = own.amplitudes[-1] / own.cov_amplitudes[-1, -1]
        unit = self.rules.std_refocused
        shown = unit * weighted / information, unit**2 / information
        own = changed(own, second=found.second)
        if self.moves:
            return changed(self, shown=(*self.shown, shown)), own
        square = shown[0] ** 2 / shown[1]
        if square > self.rules.refocused**2 * max(self.spread, 1.0):
            return changed(self, moves=True, shown=(shown,)), own
        frames = min(self.frames + 1, self.rules.innovations)
        return changed(self, spread=self.spread + (square - self.spread) / frames, frames=frames), found

    @property
    def rests_at(self) -> float | None:
        """The focal length that the latest frames have in common, once there are enough."""
        n = self.rules.rested_frames
        if not self.moves or len(self.shown) < n:
            return None
        shares, var = np.array(self.shown[-n:]).T
        var = var * max(self.spread, 1.0)
        weight = 1 / var
        mean = float(weight @ shares / weight.sum())
        t = np.arange(n) - weight @ np.arange(n) / weight.sum()
        slope, var_slope = weight * t @ shares / (weight @ t**2), 1 / (weight @ t**2)
        scatter = float(weight @ (shares - mean) ** 2)
        still = slope**2 < 9 * var_slope and scatter < n + 3 * np.sqrt(2 * n)
        return mean if still else None

    def calm(self) -> "FocusWatch":
        """Return the watch of a focal length that rests."""
        return changed(self, moves=False, shown=())
