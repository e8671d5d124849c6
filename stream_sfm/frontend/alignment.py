"""Alignment of tracks: anchored templates are warped to the current view and found in both images.

The map between a patch's pixels now and in its template's frame is projective (`core/tracks.cpp`). An affine map would
leave an error of hundredths of a pixel, the same for every patch of a turning camera, which an estimator takes for
motion: docs/mathematics.md, section 3.
"""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..config import Config, FrontendConfig
from ..geometry import Array
from ..geometry.resection import Resection
from ..pictures.prepared import GreyImage, PreparedImages
from ..record import changed, record
from .learnt.noise import ViewNoise
from .rules import ErrorRules
from .templates import SPACING_PX, TemplateAtlas, TemplateRules

WIDE = 4  # image pixels per template pixel of wide templates, for nearly textureless surfaces


class Templates(NamedTuple):
    """Templates of one `kind` with the images in which they are sought; `right` is None without right sides."""

    left: GreyImage
    right: GreyImage | None
    stored: GreyImage
    area: NDArray[np.bool_]
    kind: "TemplateAligner"


@record
class TemplateAligner:
    """Templates of one size, and the search for them in new images.

    With a `scale` of `WIDE` a template pixel is that many image pixels wide: templates are cut from the reduced images
    and found in them. All positions, warps and covariances passed in or returned are in image pixels. `area` (h, w):
    pixels around which a whole patch shows the scene; `noise`: the covariance of a view.
    """

    config: FrontendConfig
    scale: int
    area: NDArray[np.bool_]
    atlas: TemplateAtlas
    noise: ViewNoise
    rules: TemplateRules
    spacing_px: ClassVar[int] = SPACING_PX

    @classmethod
    def empty(cls, config: Config, valid: NDArray[np.bool_], scale: int = 1) -> "TemplateAligner":
        """Return an aligner without templates; `valid` (h, w): pixels of the left image that show the scene."""
        frontend, radius_px = config.frontend, config.frontend.window_radius_px
        return cls(
            frontend,
            scale,
            valid_area(valid, scale * radius_px),
            TemplateAtlas.empty(frontend.max_tracks, radius_px, of_bytes=scale == 1),
            ViewNoise.unknown(config.rules.of(ErrorRules), frontend.smoothing_px, scale),
            config.rules.of(TemplateRules),
        )

    def in_images(self, images: PreparedImages, in_both: bool) -> Templates:
        left, right = images.grey(self.scale)
        return Templates(left, right if in_both else None, self.atlas.grey, self.area, self)

    def cut(
        self, images: PreparedImages, corners: NDArray[np.intp], taken: NDArray[np.intp]
    ) -> tuple["TemplateAligner", NDArray[np.intp]]:
        """Cut new templates around whole template pixels (n, 2) of the left image.

        Returns the aligner with them, and their slots (n,), which are not in `taken`.
        """
        is_free = np.ones(self.config.max_tracks, bool)
        is_free[taken] = False
        free = np.flatnonzero(is_free)[: len(corners)]
        return changed(self, atlas=self.atlas.stored(images.grey(self.scale)[0], corners, free)), free


def valid_area(valid: NDArray[np.bool_], radius_px: int) -> NDArray[np.bool_]:
    """Return at which pixels (h, w) a patch of 2 `radius_px` + 1 lies in the image and its `valid` pixels (h, w)."""
    r = radius_px
    inside = np.zeros_like(valid)
    inside[r:-r, r:-r] = True
    return cv2.erode(valid.astype(np.uint8), np.ones((2 * r + 1, 2 * r + 1))).astype(bool) & inside


# One aligner per size of templates, by scale.
Aligners = Mapping[int, TemplateAligner]


def learn_noise(aligners: Aligners, motion: Resection, scale: NDArray[np.int64], z_px: Array) -> Aligners:
    """Return the aligners after a frame, each with its noise updated from the squared residuals of its accepted views.

    `scale` (n,) is that of each track, `z_px` (n, 4) are their views.
    """
    learnt = {}
    for size, aligner in aligners.items():
        used = motion.accepted & (scale == size)
        n = int(np.count_nonzero(np.isfinite(z_px[used])))
        fitted = round(6 * n / max(1, motion.dof + 6))  # their share of the motion's 6 unknowns
        noise = aligner.noise.learnt(float(motion.squared_residuals[used].sum()), n - fitted)
        learnt[size] = changed(aligner, noise=noise)
    return learnt
