"""Lens models of other tools, as the nearest fisheye model over the image.

Double sphere (Usenko et al., The Double Sphere Camera Model, eq. 40), EUCM (Khomutenko et al., 2016) and the
omnidirectional model (Mei and Rives, 2007) bend rays by their angle to the axis, as a fisheye with four coefficients
does: over an image both agree within thousandths of a pixel. The exception are the tangential coefficients of omni,
some tenths of a pixel in the corners, which a fisheye does not have; the window estimates errors of this kind.
"""

from collections.abc import Callable, Mapping

import numpy as np

from ...geometry import Array
from ..models import Camera
from ..settings import SETTINGS
from .document import Document, Size, camera_matrix


def _double_sphere(x: Array, y: Array, z: Array, p: Mapping[str, float]) -> Array:
    """Return the divisor; omni has only one sphere, so α is 0."""
    alpha, along = p.get("alpha", 0.0), p["xi"] + z
    return alpha * np.sqrt(x * x + y * y + along * along) + (1 - alpha) * along


def _eucm(x: Array, y: Array, z: Array, p: Mapping[str, float]) -> Array:
    return p["alpha"] * np.sqrt(p["beta"] * (x * x + y * y) + z * z) + (1 - p["alpha"]) * z


# Name -> the parameters in front of Kalibr's focal lengths, and the divisor of a unit ray.
Divisor = Callable[[Array, Array, Array, Mapping[str, float]], Array]
MODELS: dict[str, tuple[tuple[str, ...], Divisor]] = {
    "ds": (("xi", "alpha"), _double_sphere),
    "eucm": (("alpha", "beta"), _eucm),
    "omni": (("xi",), _double_sphere),
}


def nearest_fisheye(
    document: Document, where: str, model: str, size: Size, k: Array, values: Mapping[str, float], d: Array
) -> Camera:
    """Return the camera with K (3, 3), the parameters of one of `MODELS` and, for omni, radtan coefficients `d`.

    Raises ConfigError if no fisheye agrees over the image.
    """
    theta = np.repeat(np.linspace(0.01, SETTINGS.widest_rad, SETTINGS.rings), SETTINGS.spokes)
    phi = np.tile(np.linspace(0, 2 * np.pi, SETTINGS.spokes, endpoint=False), SETTINGS.rings)
    x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    divisor = MODELS[model][1](x, y, z, values)
    seen = divisor > 0
    mx, my = x[seen] / divisor[seen], y[seen] / divisor[seen]
    k1, k2, p1, p2 = (*d, *4 * [0.0])[:4]
    r2 = mx * mx + my * my
    radial = 1 + r2 * (k1 + r2 * k2)
    u = k[0, 0] * (mx * radial + 2 * p1 * mx * my + p2 * (r2 + 2 * mx * mx)) + k[0, 2]
    v = k[1, 1] * (my * radial + p1 * (r2 + 2 * my * my) + 2 * p2 * mx * my) + k[1, 2]
    inside = (u >= 0) & (u < size[0]) & (v >= 0) & (v < size[1])
    if inside.sum() < SETTINGS.fewest:
        given = f"{where}{model} with {dict(values)}"
        raise document.error(f"{given} puts hardly any ray into an image of {size[0]}×{size[1]}")
    u, v, theta, phi = u[inside], v[inside], theta[seen][inside], phi[seen][inside]
    bends = theta[:, None] ** (2 * np.arange(SETTINGS.powers) + 1)
    ratio, n = k[1, 1] / k[0, 0], len(u)
    one, zero = np.ones((n, 1)), np.zeros((n, 1))
    across, down = bends * np.cos(phi)[:, None], ratio * bends * np.sin(phi)[:, None]
    design = np.block([[across, one, zero], [down, zero, one]])
    found = np.linalg.lstsq(design, np.r_[u, v], rcond=None)[0]
    apart = np.linalg.norm((design @ found - np.r_[u, v]).reshape(2, n), axis=0).max()
    if apart > SETTINGS.most_apart_px:
        problem = f"this lens is up to {apart:.2f} px from every one that is supported"
        raise document.error(f"{where}{model}: {problem}: calibrate with pinhole-equi")
    f, cx, cy = found[[0, SETTINGS.powers, SETTINGS.powers + 1]]
    bent = (found[1 : SETTINGS.powers] / f).tolist()
    return document.camera(size, camera_matrix(f, ratio * f, cx, cy), "equidistant", bent)
