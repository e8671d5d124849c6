"""How a patch looks now: the projective map between its pixels now and in its template's frame.

What the affine part of the map leaves moves every patch of a turning camera the same way, by hundredths of a pixel that
an estimator takes for motion: docs/mathematics.md, section 3.
"""

from .. import core
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from .tracks import Tracks


def anchor_from_now(tracks: Tracks, cam_from_start: Array, projection: StereoProjection) -> tuple[Array, Array]:
    """Warps (n, 3, 2) of pixel offsets, now to anchor, for the left and for the right image.

    `tracks` in the camera `cam_from_start` (4, 4) of the front-end's chain of motions. Around the anchor the surface
    is P(δ) = (x + δ₁, y + δ₂, 1, ρ + slopes·δ), and its image now is u = A δ / (1 + n·δ) with n the relative change of
    depth: exact for a plane. Inverted, δ = W u / (1 + h·u) with W = A⁻¹ and h = −Wᵀn; a warp is W above h.
    """
    return core.anchor_from_now(
        projection.pinholes, tracks.points, tracks.slopes, tracks.anchor_from_start, cam_from_start
    )
