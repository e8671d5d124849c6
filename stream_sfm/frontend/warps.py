"""How a patch looks now: the projective map between its pixels now and in its template's frame.

What the affine part of the map leaves moves every patch of a turning camera the same way, by hundredths of a pixel that
an estimator takes for motion: docs/mathematics.md, section 3.
"""

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from .tracks import Tracks


def predicted(
    projection: StereoProjection,
    tracks: Tracks,
    cam_from_previous: Array,
    cam_from_start: Array,
    left_px: Array,
    agree: NDArray[np.bool_],
) -> tuple[Array, Array, Array, Array, Array]:
    """Where a motion (4, 4) puts tracks (n), and how their patches look there, in the camera `cam_from_start` (4, 4).

    Points (n, 4), positions (n, 2) and right columns (n,) at which they start: those of `left_px` (n, 2) that `agree`
    (n,) with the motion, or where it puts them. And warps (n, 3, 2) of pixel offsets, now to anchor, for the left and
    for the right image. Around the anchor the surface is P(δ) = (x + δ₁, y + δ₂, 1, ρ + slopes·δ), and its image now is
    u = A δ / (1 + n·δ) with n the relative change of depth: exact for a plane. Inverted, δ = W u / (1 + h·u) with
    W = A⁻¹ and h = −Wᵀn; a warp is W above h.
    """
    return core.predict_tracks(
        projection.pinholes, tracks.of_core, cam_from_previous, cam_from_start, left_px, agree
    )
