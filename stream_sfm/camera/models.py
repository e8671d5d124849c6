"""The camera model: one pinhole camera with its lens, as a calibration describes it."""

import numpy as np

from ..errors import ConfigError
from ..geometry import Array
from ..record import record, settle
from .masks import Mask, checked_mask
from .settings import SETTINGS

MAX_PIXELS = 12_500_000  # per image: a run with sensors of 12 megapixels stays below a gigabyte
MANY_PIXELS = 2**22  # per image: nothing is computed ahead for larger ones, which would take too much memory
# Numbers of coefficients of each lens model, in OpenCV's order.
DISTORTION_COEFFICIENTS = {"none": (0,), "plumb_bob": (0, 4, 5), "rational_polynomial": (8,), "equidistant": (4,)}
# Other names of these models.
DISTORTION_MODELS = {
    "plumb_bob": "plumb_bob", "radtan": "plumb_bob", "radial-tangential": "plumb_bob", "brown_conrady": "plumb_bob",
    "rational_polynomial": "rational_polynomial", "none": "none",
    "equidistant": "equidistant", "equi": "equidistant", "fisheye": "equidistant", "kannala_brandt": "equidistant",
}  # fmt: skip


@record
class Camera:
    """One pinhole camera before rectification.

    `K` (3, 3) pixels; `D` distortion coefficients in OpenCV's order; `distortion_model` one of none, plumb_bob
    (4 or 5), rational_polynomial (8), equidistant (4), or other names of these. `mask` (h, w): false (0) where
    images always show the robot itself or dirt on the lens. Raises ConfigError for impossible values.
    """

    width: int
    height: int
    K: Array
    D: tuple[float, ...] = ()
    distortion_model: str = "plumb_bob"
    mask: Mask | None = None

    def __post_init__(self) -> None:
        edges = (_pixels(self.width), _pixels(self.height))
        k, d = _numbers("K", self.K), () if self.D is None else tuple(_numbers("D", self.D).ravel().tolist())
        model = DISTORTION_MODELS.get(str(self.distortion_model).strip().lower())
        if model is None:
            names = ", ".join(DISTORTION_COEFFICIENTS)
            raise ConfigError(f"distortion model {self.distortion_model!r} is not known; known are {names}")
        values = {"width": edges[0], "height": edges[1], "K": k, "D": d, "distortion_model": model}
        for name, value in values.items():
            settle(self, name, value)
        least_px, most_px = SETTINGS.edge_px
        if min(edges) < least_px or max(edges) > most_px or self.width * self.height > MAX_PIXELS:
            raise ConfigError(
                f"camera size {self.width:.6g}×{self.height:.6g}: give width and height in pixels, each from "
                f"{least_px} to {most_px}, at most {MAX_PIXELS / 1e6:g} megapixels; reduce larger images"
            )
        if problem := _matrix_problem(k, max(edges)):
            raise ConfigError(f"camera matrix K {problem}")
        if not np.isfinite(d).all() or (any(d) and len(d) not in DISTORTION_COEFFICIENTS[model]):
            raise ConfigError(_coefficients_problem(model, d))
        if self.mask is not None:
            settle(self, "mask", checked_mask(self.mask, *edges))

    def __repr__(self) -> str:
        (fx, _, cx), (_, fy, cy) = self.K[:2]
        lens = self.distortion_model if any(self.D) else "no distortion"
        masked = "" if self.mask is None else f", {1 - self.mask.mean():.0%} masked"
        return f"<Camera {self.width}×{self.height} f=({fx:.2f}, {fy:.2f}) c=({cx:.2f}, {cy:.2f}) px, {lens}{masked}>"


def _pixels(edge: object) -> int:
    """Return an edge of the image as a whole number. Raises ConfigError."""
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


def _matrix_problem(k: Array, longer_edge: int) -> str:
    """Say what is wrong with a camera matrix for images with this longer edge, and the fix; empty if it is valid."""
    if k.shape != (3, 3) or not np.isfinite(k).all():
        return f"must be 3×3 and finite, got shape {k.shape}: {k.tolist()}"
    if k[0, 0] > 0 and k[1, 1] > 0 and np.allclose(k[:, 2], (0, 0, 1)) and k[2, :2].any():
        return f"is transposed, as MATLAB has it: {k.tolist()}; give K.T"
    if k[0, 0] <= 0 or k[1, 1] <= 0 or not np.allclose(k[2], (0, 0, 1)):
        return f"must have fx, fy > 0 and last row 0 0 1, got {k.tolist()}: is the camera calibrated?"
    if np.abs(k).max() > SETTINGS.max_k_px:
        return f"must be in pixels, none over {SETTINGS.max_k_px:g}, got {k.tolist()}"
    focal = min(k[0, 0], k[1, 1])
    if focal < SETTINGS.min_focal * longer_edge:
        cure = "give pixels of these images, not millimetres and not fractions of the image"
        return f"has a focal length of {focal:g} for images whose longer edge has {longer_edge} pixels: {cure}"
    if max(abs(k[0, 1]), abs(k[1, 0])) > SETTINGS.max_skew_px:
        return f"has a skew, which is not supported: {k.tolist()}; calibrate so that K[0, 1] is 0"
    return ""


def _coefficients_problem(model: str, d: tuple[float, ...]) -> str:
    """Say that the model does not take these coefficients; empty if it does."""
    counts = " or ".join(str(n) for n in DISTORTION_COEFFICIENTS[model] if n > 0) or "no"
    text = f"distortion model {model} takes {counts} finite coefficients, got {list(d)}"
    if any(d[8:]):
        return f"{text}; thin prism and tilt are not supported: rectify the images first"
    others = [m for m, numbers in DISTORTION_COEFFICIENTS.items() if len(d) in numbers and m != model]
    if np.isfinite(d).all() and others:
        return f"{text}; {len(d)} are those of {' or '.join(others)}"
    return text
