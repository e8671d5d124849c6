"""Of two motions that tracks with a history agree with, the one that goes on as before is the camera's.

A body that comes into view has points with a motion of their own, and far points of the background agree with that as
well, within their noise. To follow it the camera would have to jump. Where nothing was in question before, and many old
tracks go on as before, such a motion is that of a body.
"""

from dataclasses import replace

import numpy as np

from ..geometry.point_views import PointViews
from ..geometry.resection import BEYOND, MANY_VIEWS, MIN_SECOND_VIEWS, MIN_VIEWS, Resection, SecondMotion, refine
from ..geometry.se3 import Array
from ..record import record
from .tracks import FULL_HISTORY, Tracks

_AS_MANY = 0.9  # of the old tracks that agree with what jumps: so many agree by noise with either
_FRAMES = 30  # over which changes of the motion are averaged
_ASSUMED = 5.0  # frames that the assumed ones count for
_AT_MOST = 9.0  # times the mean square: a jump that was a body's says nothing of the camera


@record
class Unsteadiness:
    """By how much motions change from frame to frame in this run, by mean squares (2,) of translations and turns.

    In m² and rad², beside what is assumed of any camera, over so many `frames`.
    """

    mean_square: Array
    frames: float = _ASSUMED

    def after(self, change: Array) -> "Unsteadiness":
        """Return the same after a motion that differs by (6,) from the one predicted."""
        frames = min(self.frames + 1, _FRAMES)
        square = np.minimum((change.reshape(2, 3) ** 2).mean(axis=1), _AT_MOST * self.mean_square)
        return Unsteadiness(self.mean_square + (square - self.mean_square) / frames, frames)

    @property
    def std(self) -> Array:
        """σ (6,) of a change."""
        return np.repeat(np.sqrt(self.mean_square), 3)


def steadier(tracks: Tracks, views: PointViews, weights: Array, motion: Resection, predicted: Array) -> Resection:
    """Return the motion near the `predicted` one (4, 4) in place of one that jumps, if as many old tracks agree.

    `views` are those of `tracks` (n). What jumps is then the second motion.
    """
    near = refine(views, weights, predicted, np.zeros(views.shared.shape[2]))
    old = tracks.agreed > 0
    agree, agreed = (int(np.count_nonzero(m.accepted & old)) for m in (near, motion))
    if not near.ok or agree < max(MIN_SECOND_VIEWS, _AS_MANY * agreed):
        return motion
    only_other = motion.accepted & (near.squared_residuals > BEYOND * views.gate)
    if np.count_nonzero(only_other) < MIN_SECOND_VIEWS:  # few views tell the two apart
        return replace(near, second=motion.second) if near.share >= motion.share else motion
    return replace(near, second=SecondMotion(motion.cam_from_ref, motion.cov_pose, only_other, odds=1.0))


def without_newcomer(tracks: Tracks, motion: Resection) -> Resection:
    """Return a motion that goes on as before with a second one, that jumps, no longer in question, if that came anew.

    That is: many old tracks (n) agree with the first motion only, and hardly any with the second one.
    """
    second, old = motion.second, tracks.agreed >= FULL_HISTORY
    if second is None or np.count_nonzero(second.views & old) >= MIN_VIEWS:
        return motion
    if np.count_nonzero(motion.accepted & old) < MANY_VIEWS:
        return motion
    return replace(motion, second=replace(second, odds=0.0))
