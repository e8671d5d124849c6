"""How views move while the camera does: what a late camera and a rolling shutter turn into errors, eq. (70a)."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import se3
from ..geometry.linear import damped_solve
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection

# Frames on either side from which a velocity is taken: a polynomial of fourth order inside, of third at the ends.
_REACH = 2
_NODES = 4  # frames at least, as far as there are any
_LEAST_PX2 = 1e-2  # of a component, summed over all views: the variance of one good view


def twists(cams_from_ref: Array, stamps_ns: list[int]) -> Array:
    """Return the velocities (n, 6) with which points move in each of a few cameras, ξ per second of Exp(ξ) X.

    `cams_from_ref` (n, 4, 4) at ascending stamps; from polynomials through the poses of the frames around each.
    Zero for a single one.
    """
    n = len(stamps_ns)
    nodes = min(_NODES, n)
    if n < 2:
        return np.zeros((n, 6))
    t = np.array([(s - stamps_ns[0]) / 1e9 for s in stamps_ns])
    at = np.arange(n)
    first = np.minimum(np.maximum(at - _REACH, 0), n - nodes)
    count = np.maximum(np.minimum(at + _REACH + 1, n) - first, nodes)
    offset = np.arange(2 * _REACH + 1)
    used = offset < count[:, None]
    near = np.where(used, first[:, None] + offset, at[:, None])
    moved = se3.log(cams_from_ref[near] @ se3.inverse(cams_from_ref)[:, None])
    return np.asarray((_slopes(t[near] - t[:, None], used)[..., None] * moved).sum(axis=1))


def _slopes(t: Array, used: NDArray[np.bool_]) -> Array:
    """Return weights (n, k) of values at the times `used`, that give the slope at 0 of the polynomial through them.

    One of the times (n, k) is 0, where the value is 0 and needs no weight: derivatives of Lagrange's polynomials.
    """
    others = used & (t != 0)
    apart = t[:, :, None] - t[:, None, :]
    factors = others[:, None, :] & (apart != 0)
    ratio = np.where(factors, -t[:, None, :] / np.where(factors, apart, 1.0), 1.0).prod(axis=2)
    return np.where(others, ratio / np.where(others, t, 1.0), 0.0)


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
    def columns(self) -> Array:
        """Px per second of delay and of readout (n, 4, 2)."""
        return core.timed_views(self.pinholes, self.points, self.twist, self.row)

    def pose_by_twist(self, size: Array) -> tuple[Array, Array]:
        """Return by how much the pose of views moves with the twist (6, 6), by delay and by readout `size` (2,)."""
        information, moved = core.pose_by_twist(self.pinholes, self.points, self.row, size)
        by_delay, by_readout = np.hsplit(damped_solve(information, moved.T).T, 2)
        return by_delay, by_readout


def timing_unknowns(before: TimedViews, now: TimedViews, mean: Array, cov: Array, std_twist: Array) -> Array:
    """Return what is not known of how views have changed, with delay and readout N(`mean` (2,), `cov` (2, 2)), seconds.

    (n, 4, j) px, each of σ = 1: a constant delay or readout shows where the velocity has changed; and what either of
    them does shows where the velocity is not known, by `std_twist` (6,). Their `principal` components.
    """
    then, at_last = (before.points, before.twist, before.row), (now.points, now.twist, now.row)
    size = np.sqrt(mean**2 + np.diag(cov))
    return principal(core.timing_errors(now.pinholes, *then, *at_last, cov, size, std_twist))


def principal(unknown: Array) -> Array:
    """Return principal components (n, 4, j) of errors of views (n, 4, k) px that matter beside a good view's noise."""
    return core.principal_errors(unknown, _LEAST_PX2)
