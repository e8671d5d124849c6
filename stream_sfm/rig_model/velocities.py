"""How views move while the camera does: what a late camera and a rolling shutter turn into errors, eq. (70a)."""

from .. import core
from ..geometry.se3 import Array
from ..geometry.stereo import Pinholes, StereoProjection

# The rectified pair, and in which rows of the cameras' own images its views are exposed, as the core takes them.
TimedCameras = tuple[Pinholes, tuple[tuple[int, int], Array]]


def velocities(projection: StereoProjection, points_in_cam: Array, twist: Array) -> Array:
    """Return the velocities (n, 4), px/s, of views of homogeneous points (n, 4) with a twist (6,), or one each."""
    return core.velocities(projection.pinholes, points_in_cam, twist.reshape(-1, 6))
