"""What turns of the right camera against the left one do to views, eq. (72d)."""

import numpy as np

from .. import core
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection


def effects_of_turn(projection: StereoProjection, right_px: Array) -> Array:
    """What a turn of the right camera does at positions (n, 2) in its image: (n, 2, 3) px per radian, eq. (72d)."""
    return core.effects_of_turn(projection.pinholes, right_px)


def far_right_px(projection: StereoProjection, left_px: Array) -> Array:
    """Where points at infinity that are seen at left positions (n, 2) are in the right image (n, 2)."""
    return np.asarray(left_px + np.array([projection.cx_right_px - projection.cx_left_px, 0.0]))
