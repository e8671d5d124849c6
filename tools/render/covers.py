"""What covers part of every image in the same place: dirt on the glass, and the camera's own body in view."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from .textures import fractal

Image = NDArray[np.float32]
Layer = tuple[Image, Image]  # opacity from 0 to 1, and grey levels (h, w)
_TEXEL_M = 0.01  # of noise, whose scale in pixels alone counts here


class Cover(Protocol):
    """A layer over the images of a side, 0 left and 1 right, of a size (width, height) in pixels."""

    def layer(self, side: int, size_px: tuple[int, int]) -> Layer:
        """Return the opacity and the grey levels of the layer."""


def covered(light: Image, covers: tuple[Cover, ...], side: int) -> Image:
    """The light of an image (h, w) of a side behind its covers, the last of them in front."""
    for cover in covers:
        opacity, grey = cover.layer(side, (light.shape[1], light.shape[0]))
        light = light + opacity * (grey - light)
    return light


@dataclass(frozen=True, slots=True)
class Dirt:
    """Blurred spots on the glass, other ones on each lens: `share` of the width is the size of a spot."""

    seed: int
    spots: int
    share: float

    def layer(self, side: int, size_px: tuple[int, int]) -> Layer:
        """Spots anywhere in the image, opaque in the middle, with soft edges."""
        return _dirt(self, side, size_px)


@lru_cache(maxsize=4)
def _dirt(dirt: Dirt, side: int, size_px: tuple[int, int]) -> Layer:
    rng = np.random.default_rng((dirt.seed, side))
    width, height = size_px
    opacity = np.zeros((height, width), np.float32)
    for _ in range(dirt.spots):
        at = rng.uniform((0.0, 0.0), size_px)
        axes = dirt.share * width * rng.uniform(0.3, 0.6, 2)
        cv2.ellipse(opacity, (tuple(at), tuple(2 * axes), float(rng.uniform(0, 180))), float(rng.uniform(0.6, 1)), -1)
    opacity = cv2.GaussianBlur(opacity, (0, 0), 0.15 * dirt.share * width)
    return opacity, np.full((height, width), 55, np.float32)


@dataclass(frozen=True, slots=True)
class Reflection:
    """What a windscreen mirrors: a faint, textured layer over the lower part, with a disparity of its own.

    `height`: share of the image; `opacity`: share of the light; `disparity`: as a share of the width.
    """

    seed: int
    height: float
    opacity: float
    disparity: float

    def layer(self, side: int, size_px: tuple[int, int]) -> Layer:
        """The same part in both images, farther left in the right one; it fades out upwards."""
        return _reflection(self, side, size_px)


@lru_cache(maxsize=4)
def _reflection(mirrored: Reflection, side: int, size_px: tuple[int, int]) -> Layer:
    rng = np.random.default_rng(mirrored.seed)
    width, height = size_px
    fade = np.clip((np.arange(height) / height - 1 + mirrored.height) / 0.1, 0, 1)
    opacity = np.repeat(mirrored.opacity * fade[:, None], width, axis=1).astype(np.float32)
    grey = np.clip(110 + 45 * fractal(rng, (height, width), _TEXEL_M, coarsest_m=0.4), 4, 250)
    moved = np.array([[1, 0, -side * mirrored.disparity * width], [0, 1, 0]], np.float32)
    return opacity, cv2.warpAffine(grey, moved, size_px, borderMode=cv2.BORDER_REFLECT)


@dataclass(frozen=True, slots=True)
class OwnBody:
    """A textured part of the robot along the lower edge, with a jagged outline; nearer than anything else.

    `height` and `width`: shares of the image; `disparity`: how far apart both cameras see it, as a share of the width.
    """

    seed: int
    height: float
    width: float
    disparity: float

    def layer(self, side: int, size_px: tuple[int, int]) -> Layer:
        """The same part in both images, farther left in the right one."""
        return _own_body(self, side, size_px)


@lru_cache(maxsize=4)
def _own_body(body: OwnBody, side: int, size_px: tuple[int, int]) -> Layer:
    rng = np.random.default_rng(body.seed)
    width, height = size_px
    begin = rng.uniform(0, 1 - body.width)
    x = np.linspace(begin, begin + body.width, 7) * width
    top = height * (1 - body.height * np.concatenate([[0], rng.uniform(0.6, 1, 5), [0]]))
    opacity = np.zeros((height, width), np.float32)
    cv2.fillPoly(opacity, [np.round(np.stack([x, top], axis=1)).astype(np.int32)], 1.0)
    grey = 90 + 25 * fractal(rng, (height, width), _TEXEL_M, coarsest_m=0.4)
    moved = np.array([[1, 0, -side * body.disparity * width], [0, 1, 0]], np.float32)
    opacity, grey = (cv2.warpAffine(x, moved, size_px, borderMode=cv2.BORDER_REFLECT) for x in (opacity, grey))
    return opacity, np.clip(grey, 4, 250)
