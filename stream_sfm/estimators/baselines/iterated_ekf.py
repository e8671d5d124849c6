"""Baseline: the strongest filter, an iterated EKF in the newest camera, over inverse depths and the world's pose.

It is the window with b = 1: Gauss-Newton on the frame's views and the joint prior is the iterated update (Bell and
Cathey, The iterated Kalman filter update as a Gauss-Newton method, 1993), the motion of a frame is free, and the world
is one more pose that no view depends on, so that iterating gains no information about where the world is. What it lacks
is what a longer window has: views of the last frames that can be linearised anew.
"""

import msgspec

from ...config import Config
from ...geometry.stereo import StereoProjection
from ..cross_frame.window import CrossFrame


class IteratedEkf(CrossFrame):
    """A window of one frame, whatever the configuration says."""

    name = "iterated-ekf"

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        one = msgspec.structs.replace(config.window, frames=1)
        super().__init__(projection, msgspec.structs.replace(config, window=one))
