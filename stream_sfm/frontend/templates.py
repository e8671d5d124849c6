"""Anchored templates: every point is aligned against the patch of its first frame, never against the last one.

A patch that is followed from frame to frame drifts towards zero motion under image noise, and no estimator repairs
that. The template's own noise moves the point once and for all, which harms nobody. A patch is warped by the map that
pose, depth and slope predict (`core/tracks.cpp`), then found by Gauss-Newton (`core/patches.cpp`).
"""

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config.point_rules import TemplateRules
from ..geometry import Array
from ..record import record
from .prepared import GreyImage

Grey = NDArray[np.float32]
JUST_CUT = np.array([1.0, 0.0])  # gain and offset of an image over a template that has been cut from it
SPACING_PX = 2  # pixels between samples: smoothed neighbours share their noise, so every second one says as much
_RULES = TemplateRules()  # places of all maps are verified with the defaults


@record
class Patches:
    """Warped templates (n), ready to be aligned with an image.

    Of k × k samples of 2 `radius_px` + 1 pixels, `spacing_px` apart: the weighted pseudo-inverse `inverse` (n, 3, k²)
    of their slopes along u and v and of their grey values, each of mean zero; the products `information` (n, 3, 3) of
    these; and the mean grey value `level` (n,).
    """

    inverse: Grey
    information: Array
    level: Grey
    radius_px: int
    spacing_px: int

    def align(self, image: GreyImage, starts_px: Array) -> tuple[Array, NDArray[np.bool_], Array]:
        """Find the patches in an image, from starts (n, 2).

        Returns positions (n, 2), whether each was found (n,), and the deviation (n,) of the grey differences that are
        left, in grey values of the template, inf where it was not found.
        """
        just_cut = np.tile(JUST_CUT, (len(starts_px), 1))
        patches = self.inverse, self.information, self.level, just_cut, self.radius_px, self.spacing_px
        return core.align_patches(image, starts_px, *patches, _RULES)[:3]


@record
class TemplateAtlas:
    """Patches (slots, side, side) of all tracks by slot.

    `radius_px` of the alignment window (2r+1 pixels wide); patches are stored half as large again, so that a warp
    finds its pixels.
    """

    radius_px: int
    grey: GreyImage

    @classmethod
    def empty(cls, slots: int, radius_px: int, of_bytes: bool = False) -> "TemplateAtlas":
        """Return an atlas with so many slots, for patches of images of bytes or of floats."""
        shape = (slots, 2 * _half(radius_px) + 1, 2 * _half(radius_px) + 1)
        return cls(radius_px, np.zeros(shape, np.uint8) if of_bytes else np.zeros(shape, np.float32))

    def stored(self, image: GreyImage, points_px: NDArray[np.intp], slots: NDArray[np.intp]) -> "TemplateAtlas":
        """Return the atlas with patches cut around whole pixels (n, 2) in these slots (n,)."""
        grey = self.grey.copy()
        core.store_patches(grey, image, points_px, slots)
        return TemplateAtlas(self.radius_px, grey)

    def fits(self, anchor_from_now: Array) -> NDArray[np.bool_]:
        """Whether warps (n, 3, 2) stay inside the stored patches and do not blow them up beyond recognition."""
        return core.templates_fit(anchor_from_now, self.radius_px, _half(self.radius_px), _RULES.least_area)

    def warped(self, slots: NDArray[np.intp], anchor_from_now: Array) -> Patches:
        """Return the templates of `slots` (n,) as the image should show them now; warps (n, 3, 2) of pixel offsets."""
        patches = core.warp_patches(self.grey, slots, anchor_from_now, self.radius_px, SPACING_PX, _RULES)
        return Patches(*patches, self.radius_px, SPACING_PX)


def _half(radius_px: int) -> int:
    """Half width of a stored patch: of the window, with 2 px for derivatives and room for warps of a scale to 1.7."""
    return int(1.7 * (radius_px + 2))
