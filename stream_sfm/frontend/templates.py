"""Anchored templates: every point is aligned against the patch of its first frame, never against the last one.

A patch that is followed from frame to frame drifts towards zero motion under image noise, and no estimator can correct
that. The template's own noise displaces the point once and for all, which does no harm. A patch is warped by the map
that pose, depth and slope predict (`core/tracks.cpp`), then found by Gauss-Newton (`core/patches.cpp`).
"""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config.section import Section, expert
from ..geometry import Array
from ..pictures.prepared import GreyImage
from ..record import record


class TemplateRules(Section, frozen=True, kw_only=True):
    """How templates are found in new images, and how certain their positions are."""

    # Measured on four logs over four starts: for a rendered one, pose NEES falls from 16.4 to 10.8 and aligned ATE
    # from 1.19 to 0.74 mm; the others are unchanged. 0.6 to 1.0 are nearly as good.
    weights_width: Annotated[float, expert("σ of the weights over a patch, its radii", 0.05, 1e6)] = 0.8
    # Two or three are usually enough; an image that is more blurred than the template takes more.
    steps: Annotated[int, expert("Gauss-Newton steps of an alignment, at most", 1, 1000)] = 20
    # Chosen by hand: with a larger ratio the steps do not converge.
    step_ratio: Annotated[float, expert("largest ratio of each step to the previous one", 0.01, 1)] = 0.7
    # After a step, a tenth of it is left, which is below the noise floor of a view.
    converged_px: Annotated[float, expert("step that ends an alignment, px", 1e-6, 10)] = 0.05
    # Chosen by hand: no exposure changes by more within a track.
    max_gain: Annotated[float, expert("largest factor on grey values, or its inverse", 1, 1e6)] = 10.0
    # Chosen by hand: below it the image shows something else.
    min_explained: Annotated[float, expert("least share of image variance that a template explains", 0, 1)] = 0.5
    # Steps of automatic exposure are larger.
    same_level: Annotated[float, expert("change of grey levels below which exposure is the same", 0, 1e8)] = 0.05
    # The light on a single patch may change by a fifth.
    same_exposure: Annotated[float, expert("largest difference of the log gains under one light", 0, 100)] = 0.18
    # This many do not agree by chance.
    exposure_views: Annotated[int, expert("least views that show another exposure or light", 1, 10_000)] = 12
    exposures: Annotated[int, expert("largest number of lights on the templates of a frame", 1, 100)] = 3
    # This is σ₀ of eq. (15), chosen by hand: the error of interpolation and rectification, even in a perfect match.
    std_floor_px: Annotated[float, expert("least σ of a position, px", 0, 10)] = 0.03
    # Rounding to whole grey values alone leaves 0.4 between two images.
    least_error_grey: Annotated[float, expert("least σ of a grey difference", 1e-3, 255)] = 0.5
    # The covariance of such a side is then so large that it has no effect.
    unknown_error_grey: Annotated[float, expert("σ of grey differences of a side that is missing", 1, 1e6)] = 255.0
    # σ of a position along an edge stays within 32 times the σ across it.
    edge_damping: Annotated[float, expert("damping of a gradient matrix, share of its trace", 0, 1)] = 1e-3
    # Below it, the patch has grown by more than √5 and shows detail that the template lacks.
    least_area: Annotated[float, expert("least area of a template that a pixel covers, pixels", 0, 1)] = 0.2


Grey = NDArray[np.float32]
JUST_CUT = np.array([1.0, 0.0])  # gain and offset of an image over a template just cut from it
SPACING_PX = 2  # pixels between samples: smoothed neighbours share their noise, so every second one suffices
_RULES = TemplateRules()  # places of all maps are verified with the default settings


@record
class Patches:
    """Warped templates (n), ready to be aligned with an image.

    Each has k × k samples, `spacing_px` apart, in a window of 2 `radius_px` + 1 pixels. `inverse` (n, 3, k²): the
    weighted pseudo-inverse of their slopes along u and v and of their grey values, each of mean zero; `information`
    (n, 3, 3): the products of these; `level` (n,): the mean grey value.
    """

    inverse: Grey
    information: Array
    level: Grey
    radius_px: int
    spacing_px: int

    def align(self, image: GreyImage, starts_px: Array) -> tuple[Array, NDArray[np.bool_], Array]:
        """Find the patches in an image, from starts (n, 2).

        Returns positions (n, 2), whether each was found (n,), and the standard deviation (n,) of the residual grey
        differences, in grey values of the template, inf if it was not found.
        """
        just_cut = np.tile(JUST_CUT, (len(starts_px), 1))
        patches = self.inverse, self.information, self.level, just_cut, self.radius_px, self.spacing_px
        return core.align_patches(image, starts_px, *patches, _RULES)[:3]


@record
class TemplateAtlas:
    """Patches `grey` (slots, side, side) of all tracks by slot.

    `radius_px`: r of the alignment window, which is 2r + 1 pixels wide; the stored patches are larger, with room for a
    warp.
    """

    radius_px: int
    grey: GreyImage

    @classmethod
    def empty(cls, slots: int, radius_px: int, of_bytes: bool = False) -> "TemplateAtlas":
        """Return an atlas with empty slots, for patches of byte or float images."""
        shape = (slots, 2 * _half(radius_px) + 1, 2 * _half(radius_px) + 1)
        return cls(radius_px, np.zeros(shape, np.uint8) if of_bytes else np.zeros(shape, np.float32))

    def stored(self, image: GreyImage, points_px: NDArray[np.intp], slots: NDArray[np.intp]) -> "TemplateAtlas":
        """Return the atlas with patches cut around whole pixels (n, 2) in these slots (n,)."""
        grey = self.grey.copy()
        core.store_patches(grey, image, points_px, slots)
        return TemplateAtlas(self.radius_px, grey)

    def fits(self, anchor_from_now: Array) -> NDArray[np.bool_]:
        """Return which warps (n, 3, 2) stay inside the stored patches and do not enlarge them too much."""
        return core.templates_fit(anchor_from_now, self.radius_px, _half(self.radius_px), _RULES.least_area)

    def warped(self, slots: NDArray[np.intp], anchor_from_now: Array) -> Patches:
        """Return the templates of `slots` (n,) as the image should show them now; warps (n, 3, 2) of pixel offsets."""
        patches = core.warp_patches(self.grey, slots, anchor_from_now, self.radius_px, SPACING_PX, _RULES)
        return Patches(*patches, self.radius_px, SPACING_PX)


def _half(radius_px: int) -> int:
    """Return the half width of a stored patch: the window's plus 2 px for derivatives, times 1.7 for scaling warps."""
    return int(1.7 * (radius_px + 2))
