"""How views move while the camera does: what a late camera and a rolling shutter turn into errors, eq. (70a)."""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import se3
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection

# Frames on either side from which a velocity is taken: a polynomial of fourth order inside, of third at the ends.
_REACH = 2
_NODES = 4  # frames at least, as far as there are any
_RIGHT_U = np.array([0.0, 0.0, 1.0, 0.0])  # what a delay moves of a view
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


def velocities_by_twist(projection: StereoProjection, points_in_cam: Array) -> Array:
    """Return ∂ż/∂ξ̇ (n, 4, 6) of homogeneous points (n, 4) in the camera: px/s per unit of the points' twist."""
    return core.velocities_by_twist(projection.pinholes, points_in_cam)


def velocities(projection: StereoProjection, points_in_cam: Array, twist: Array) -> Array:
    """Return the velocities (n, 4), px/s, of views of homogeneous points (n, 4) with a twist (6,), or one each."""
    return core.moving_views(projection.pinholes, points_in_cam, twist.reshape(-1, 6))[1]


class TimedViews:
    """Views of homogeneous points (n, 4) that move with a twist (6,), as delay and readout see them.

    `row_of`: as in `RigModel`; None: the readout does nothing. `columns` (n, 4, 2): px per second of delay and of
    readout.
    """

    def __init__(
        self,
        projection: StereoProjection,
        points_in_cam: Array,
        twist: Array,
        row_of: Callable[[Array], Array] | None,
    ) -> None:
        self._projection, self._points = projection, points_in_cam
        z_px, velocity = core.moving_views(projection.pinholes, points_in_cam, twist[None])
        self._row = np.zeros(z_px.shape) if row_of is None else row_of(z_px)
        self._row[np.isnan(self._row)] = 0.0  # of sides that were not seen
        self.columns = np.stack([velocity * _RIGHT_U, velocity * self._row], axis=2)

    @cached_property
    def by_twist(self) -> Array:
        """Px per second and unit of the twist (n, 4, 6)."""
        return velocities_by_twist(self._projection, self._points)

    @property
    def by_delay(self) -> Array:
        """Px per second of delay and unit of the twist (n, 4, 6)."""
        return self.by_twist * _RIGHT_U[:, None]

    @property
    def by_readout(self) -> Array:
        """Px per second of readout and unit of the twist (n, 4, 6)."""
        return self.by_twist * self._row[:, :, None]


def timing_unknowns(before: TimedViews, now: TimedViews, mean: Array, cov: Array, std_twist: Array) -> Array:
    """Return what is not known of how views have changed, with delay and readout N(`mean` (2,), `cov` (2, 2)), seconds.

    (n, 4, j) px, each of σ = 1: a constant delay or readout shows where the velocity has changed; and what either of
    them does shows where the velocity is not known, by `std_twist` (6,). Their `principal` components.
    """
    of_time = (now.columns - before.columns) @ np.linalg.cholesky(cov)
    size = np.sqrt(mean**2 + np.diag(cov))
    unknown = np.concatenate(
        [of_time, size[0] * std_twist * now.by_delay, size[1] * std_twist * now.by_readout], axis=2
    )
    return principal(unknown)


def principal(unknown: Array) -> Array:
    """Return principal components (n, 4, j) of errors of views (n, 4, k) px that matter beside a good view's noise."""
    return core.principal_errors(unknown, _LEAST_PX2)
