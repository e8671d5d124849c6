"""The masks of a run as pictures of a page: what of each image is left out."""

import numpy as np
from markupsafe import Markup

from ..camera.masks import Mask
from ..camera.rig import MonoRig, StereoRig

_CELLS = 64  # of a picture in a row; smaller parts are not seen on a page


def pictures(rig: StereoRig | MonoRig) -> list[Markup]:
    """A picture of the mask of each camera that has one."""
    return [_picture(side, camera.mask) for side, camera in rig.cameras.items() if camera.mask is not None]


def _picture(side: str, mask: Mask) -> Markup:
    every = -(-mask.shape[1] // _CELLS)
    hidden = ~mask[::every, ::every]
    height, width = hidden.shape
    edges = np.diff(np.pad(hidden, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    begins, ends = np.argwhere(edges > 0), np.argwhere(edges < 0)[:, 1]
    path = "".join(f"M{x} {y}H{end}v1H{x}z" for (y, x), end in zip(begins.tolist(), ends.tolist(), strict=True))
    return Markup(
        '<figure><figcaption>mask of the {side} camera, {share} of its image</figcaption><svg viewBox="-1 -1 {w} {h}" '
        'role="img"><rect width="{width}" height="{height}" fill="none" stroke="currentColor" stroke-width=".3"/>'
        '<path d="{path}" fill="currentColor" opacity=".5"/></svg></figure>'
    ).format(
        side=side,
        share=f"{100 * (1 - mask.mean()):.0f} %",
        w=width + 2,
        h=height + 2,
        width=width,
        height=height,
        path=path,
    )
