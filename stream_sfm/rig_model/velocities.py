"""How views move while the camera does: what a late camera and a rolling shutter turn into errors, eq. (70a)."""

from collections.abc import Callable

import numpy as np

from .. import core
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection


def twists(cams_from_ref: Array, stamps_ns: list[int]) -> Array:
    """Return the velocities (n, 6) with which points move in each of a few cameras, ξ per second of Exp(ξ) X.

    `cams_from_ref` (n, 4, 4) at ascending stamps; see `core.twists`.
    """
    return core.twists(cams_from_ref, np.array([(s - stamps_ns[0]) / 1e9 for s in stamps_ns]))


def velocities(projection: StereoProjection, points_in_cam: Array, twist: Array) -> Array:
    """Return the velocities (n, 4), px/s, of views of homogeneous points (n, 4) with a twist (6,), or one each."""
    return core.velocities(projection.pinholes, points_in_cam, twist.reshape(-1, 6))


class TimedViews:
    """Views of homogeneous points (n, 4) that move with a twist (6,), as delay and readout see them.

    `row_of`: as in `RigModel`; None: the readout does nothing. `row` (n, 4): what it says.
    """

    def __init__(
        self,
        projection: StereoProjection,
        points_in_cam: Array,
        twist: Array,
        row_of: Callable[[Array], Array] | None,
    ) -> None:
        z_px = projection.project_homogeneous(points_in_cam)
        self.row = np.zeros(z_px.shape) if row_of is None else row_of(z_px)
        self.pinholes, self.points, self.twist = projection.pinholes, points_in_cam, twist[None]

    @property
    def of_core(self) -> tuple[Array, Array, Array]:
        """The points as the compiled core takes them."""
        return self.points, self.twist, self.row

    @property
    def columns(self) -> Array:
        """Px per second of delay and of readout (n, 4, 2)."""
        return core.timed_views(self.pinholes, self.points, self.twist, self.row)

    def cov_of_pose(self, size: Array, cov_twist: Array) -> Array:
        """Return the covariance (6, 6) of the pose of views by a twist of covariance (6, 6), eq. (70b).

        `size` (2,): delay and readout, root mean squares, seconds.
        """
        return core.cov_of_timed_pose(self.pinholes, self.points, self.row, size, cov_twist)


def timing_unknowns(before: TimedViews, now: TimedViews, mean: Array, cov: Array, std_twist: Array) -> Array:
    """Return what is not known of how views have changed, with delay and readout N(`mean` (2,), `cov` (2, 2)), seconds.

    (n, 4, j) px, each of σ = 1: a constant delay or readout shows where the velocity has changed; and what either of
    them does shows where the velocity is not known, by `std_twist` (6,). Their principal components.
    """
    size = np.sqrt(mean**2 + np.diag(cov))
    return core.timing_unknowns(now.pinholes, before.of_core, now.of_core, cov, size, std_twist)
