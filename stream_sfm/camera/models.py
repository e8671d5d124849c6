"""Camera models: one pinhole camera with its lens, as a calibration describes it."""

from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError
from ..geometry.se3 import Array

MAX_PIXELS = 12_500_000  # of an image: a run with sensors of 12 megapixels stays below a gigabyte
MANY_PIXELS = 2**22  # of an image: nothing is done ahead of larger ones, for which there would be no memory
_MIN_EDGE_PX = 16  # of an image: less holds no patch
_MAX_EDGE_PX = 2**15 - 1  # of an image: OpenCV's maps count in 16 bits
_MAX_K_PX = 1e6  # of any number in K: a telescope on the largest image has a tenth of it
# How many coefficients each lens model takes, in OpenCV's order.
DISTORTION_COEFFICIENTS = {
    "none": (0,),
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (8,),
    "equidistant": (4,),
}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Camera:
    """One pinhole camera as delivered, before rectification.

    `K` (3, 3) pixels; `D` distortion coefficients in OpenCV's order; `distortion_model` one of none, plumb_bob
    (4 or 5), rational_polynomial (8), equidistant (4). Raises ConfigError for the impossible.
    """

    width: int
    height: int
    K: Array
    D: tuple[float, ...] = ()
    distortion_model: str = "plumb_bob"

    def __post_init__(self) -> None:
        edges = (_pixels(self.width), _pixels(self.height))
        k, d = _numbers("K", self.K), tuple(_numbers("D", self.D).ravel().tolist())
        for name, value in (("width", edges[0]), ("height", edges[1]), ("K", k), ("D", d)):
            object.__setattr__(self, name, value)
        if min(edges) < _MIN_EDGE_PX or max(edges) > _MAX_EDGE_PX or self.width * self.height > MAX_PIXELS:
            raise ConfigError(
                f"camera size {self.width:.6g}×{self.height:.6g}: give width and height in pixels, each from "
                f"{_MIN_EDGE_PX} to {_MAX_EDGE_PX}, together at most {MAX_PIXELS / 1e6:g} megapixels; reduce larger "
                "images"
            )
        if k.shape != (3, 3) or not np.isfinite(k).all():
            raise ConfigError(f"camera matrix K must be 3×3 and finite, got shape {k.shape}: {k.tolist()}")
        if k[0, 0] <= 0 or k[1, 1] <= 0 or not np.allclose(k[2], (0, 0, 1)):
            raise ConfigError(
                f"camera matrix K must have fx, fy > 0 and last row 0 0 1, got {k.tolist()}: "
                "is the camera calibrated?"
            )
        if np.abs(k).max() > _MAX_K_PX:
            raise ConfigError(f"camera matrix K must be in pixels, none over {_MAX_K_PX:g}, got {k.tolist()}")
        allowed = DISTORTION_COEFFICIENTS.get(self.distortion_model)
        if allowed is None:
            names = ", ".join(DISTORTION_COEFFICIENTS)
            raise ConfigError(f"distortion model {self.distortion_model!r} is not known; known are {names}")
        if not np.isfinite(d).all() or (any(d) and len(d) not in allowed):
            raise ConfigError(
                f"distortion model {self.distortion_model} takes {allowed} finite coefficients, got {list(d)}"
            )

    def __repr__(self) -> str:
        (fx, _, cx), (_, fy, cy) = self.K[:2]
        lens = self.distortion_model if any(self.D) else "no distortion"
        return f"<Camera {self.width}×{self.height} f=({fx:.2f}, {fy:.2f}) c=({cx:.2f}, {cy:.2f}) px, {lens}>"


def _pixels(edge: object) -> int:
    """An edge of the image as a whole number. Raises ConfigError."""
    if isinstance(edge, int | float | np.integer | np.floating) and edge == edge // 1:
        return int(edge)
    given = "an array" if isinstance(edge, np.ndarray | list | tuple) else repr(edge)
    raise ConfigError(
        f"the camera's size holds {given}: give whole numbers of pixels, as in Camera(width=640, height=480, K=...)"
    )


def _numbers(name: str, value: object) -> Array:
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ConfigError(f"the camera's {name} is {value!r}: give an array of numbers") from None
