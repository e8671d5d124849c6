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
from .tracks import FULL_HISTORY, Tracks


def steadier(tracks: Tracks, views: PointViews, weights: Array, motion: Resection, predicted: Array) -> Resection:
    """Return the motion near the `predicted` one (4, 4) in place of one that jumps, if as many old tracks agree.

    `views` are those of `tracks` (n). What jumps is then the second motion.
    """
    near = refine(views, weights, predicted, np.zeros(views.shared.shape[2]))
    old = tracks.agreed > 0
    agree, agreed = (int(np.count_nonzero(m.accepted & old)) for m in (near, motion))
    if not near.ok or agree < max(MIN_SECOND_VIEWS, agreed):
        return motion
    only_other = motion.accepted & (near.squared_residuals > BEYOND * views.gate)
    if np.count_nonzero(only_other) < MIN_SECOND_VIEWS:  # the same motion, seen twice
        return motion
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
