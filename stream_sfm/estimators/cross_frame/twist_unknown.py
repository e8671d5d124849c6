"""What is not known of the camera's velocity moves all right views of a frame alike, where the right camera is late.

The velocity of the newest frame is an extrapolation. Where a delay is probable, its error is an unknown of the frame,
eq. (36b): six amplitudes of σ = 1. Once later frames tell the velocity, what is left of it is in the right rows, from
which the front-end took the delay out by a velocity of its own.
"""

import numpy as np

from ... import core
from ...geometry.linear import scaled_cholesky
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from .inverse_depth import WhitenedViews

TWIST = 6  # amplitudes


def twist_columns(
    projection: StereoProjection, views: WhitenedViews, points: Array, delay_s: float, cov_twist: Array
) -> Array:
    """Return what an error of the twist, of covariance (6, 6), does to views of homogeneous points (V, 4).

    (V, 4, 6) px, of cameras of which the right one is late by some `delay_s`. A missing side has none.
    """
    by_twist = np.stack([core.velocities(projection, points, e[None]) for e in np.eye(TWIST)], axis=2)
    moved = np.zeros_like(by_twist)
    moved[:, 2:] = delay_s * by_twist[:, 2:]
    moved[~np.isfinite(views.expected_px)] = 0.0
    return np.asarray(moved @ scaled_cholesky(cov_twist))


def left_in_rows(own: Array) -> Array:
    """Return twist columns (n, 4, 6) of a frame that is not the newest any more: those of the right rows."""
    rest = np.zeros_like(own)
    rest[:, 3] = own[:, 3]
    return rest


def with_room(own: Array) -> Array:
    """Return columns (n, 4, e) of frames whose twist is known, with those of a twist."""
    return np.concatenate([own, np.zeros((*own.shape[:2], TWIST))], axis=2)
