"""Rectification of any calibrated pair: common focal length and rows, with the baseline along +x.

The rectified axes follow from `right_from_left` (x along the baseline, z between the two optical axes), whatever
rectification a log proposes. Poses are reported in the axes of the physical left camera.
"""

from collections.abc import Sequence
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import RigError
from ..geometry import Array, se3
from ..geometry.stereo import StereoProjection, places_over_image
from .lens import distortion, project_into_image, rays_of
from .models import Camera
from .over_image import ExposedRows, FocalEffect
from .rig import MonoRig, StereoRig
from .settings import SETTINGS

_Side = tuple[Camera, Array, Array]  # a camera, its rectifying rotation, and the matrix of its rectified image
_Maps = tuple[cv2.typing.MatLike, cv2.typing.MatLike]


class Rectifier:
    """Rectifies a rig's images to pinholes with a common focal length and common rows, the baseline along +x.

    `projection`: that of the rectified pair, or of one camera with a virtual right one; `rect_from_cam` (3, 3): its
    axes from those of the physical left camera; `fingerprint`: equal if images are rectified in the same way. Raises
    RigError if left and right are exchanged or not beside each other, or if the calibration leaves no image.
    """

    def __init__(self, rig: StereoRig | MonoRig) -> None:
        cameras, rotations = list(rig.cameras.values()), _rectifying_rotations(rig)
        width, height = cameras[0].width, cameras[0].height
        self.rect_from_cam: Array = rotations[0]
        extents, spans = _extents(rig, cameras, rotations)
        f_lens = float(np.mean([c.K[[0, 1], [0, 1]] for c in cameras]))
        f_fit = float(min((width - 1) / spans[0], (height - 1) / spans[1]))
        same = f_fit > SETTINGS.same_focal_fraction * f_lens
        f = f_lens if same else max(f_fit, SETTINGS.min_focal_fraction * f_lens)
        middle = [(e[0] + e[1]) / 2 for e in extents]
        cx = [(width - 1) / 2 - f * m[0] for m in middle]
        cy = (height - 1) / 2 - f * float(np.mean([m[1] for m in middle]))
        baseline = SETTINGS.virtual_baseline if isinstance(rig, MonoRig) else rig.baseline_m
        self.projection = StereoProjection(f, cx[0], cx[-1], cy, baseline, width, height, virtual_right=rig.unscaled)
        matrices = [np.array([[f, 0, x], [0, f, cy], [0, 0, 1]]) for x in cx]
        self._sides = list(zip(cameras, rotations, matrices, strict=True))
        lenses = [(c.width, c.height, c.K.tolist(), [float(d) for d in c.D], c.distortion_model) for c in cameras]
        self.fingerprint = repr((lenses, [r.tolist() for r in rotations], [m.tolist() for m in matrices]))

    @cached_property
    def _maps(self) -> list[_Maps | None]:
        return [_maps(*side) for side in self._sides]  # lazy: the projection alone needs none

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Which pixels (h, w) of the rectified left image show the scene. Raises RigError if hardly any does."""
        return self._shows_scene(0)

    @cached_property
    def valid_in_right(self) -> NDArray[np.bool_] | None:
        """The same for the right image if it has a mask, otherwise None."""
        return None if self._sides[-1][0].mask is None or len(self._sides) < 2 else self._shows_scene(1)

    def check_image(self) -> None:
        """Raise the RigError of `valid` if hardly any node of the rectified left image is in the raw one."""
        if len(self._places[0][1]) < SETTINGS.min_valid * len(self._nodes):
            raise _no_image([camera for camera, *_ in self._sides])

    def _shows_scene(self, side: int) -> NDArray[np.bool_]:
        camera = self._sides[side][0]
        white = np.full((self.projection.height, self.projection.width), 255, np.uint8)
        if (valid := self._rectified(white, side) == 255).mean() < SETTINGS.min_valid:
            raise _no_image([camera for camera, *_ in self._sides])
        if camera.mask is None:
            return np.asarray(valid)
        valid = self._rectified(np.where(camera.mask, white, 0).astype(np.uint8), side) == 255
        if valid.mean() < SETTINGS.min_valid:
            which, form = ("left", "right")[side], "make it black at excluded pixels, and white elsewhere"
            raise RigError(f"the mask of the {which} camera leaves hardly any of its image: {form}")
        return np.asarray(valid)

    def rectify(self, *images: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
        """Rectify an image (h, w) uint8 of each camera; return the same array if it is rectified already."""
        return [self._rectified(image, side) for side, image in enumerate(images)]

    def raw_shifts_px(self, z_px: Array) -> Array:
        """Return right minus left positions (n, 2) px in the raw images of views (n, 4) in the rectified ones.

        A picture that is burnt into both images is at the same pixels there, wherever the cameras look.
        """
        left, right = (self._rays(side, z_px[:, 2 * side : 2 * side + 2]) for side in (0, 1))
        return project_into_image(self._sides[1][0], right) - project_into_image(self._sides[0][0], left)

    def _rays(self, side: int, px: Array) -> Array:
        """Return the rays (n, 3) of the recorded camera of a side at places (n, 2) px in its rectified image."""
        by_u, by_v, at_origin = self._rays_by_pixel[side]
        return np.asarray(px[:, :1] * by_u + px[:, 1:] * by_v + at_origin)

    @cached_property
    def _rays_by_pixel(self) -> list[Array]:
        """For each side, the rays of the recorded camera by homogeneous places in the rectified image, (3, 3)."""
        return [np.linalg.inv(k_rectified).T @ rotation for _, rotation, k_rectified in self._sides]

    @cached_property
    def rows_of(self) -> ExposedRows:
        """The rows of the raw images in which views are exposed."""
        rows = [(raw_px[:, 1:] + 0.5) / side[0].height - 0.5 for side, _, raw_px in self._places]
        return self._polynomials(rows)[0]  # the readout time is that of `height` rows

    @cached_property
    def by_focal(self) -> FocalEffect:
        """The effect of a longer focal length of both cameras on views."""
        moved = []
        for (camera, rotation, k_rectified), _, raw_px in self._places:
            middle_px = camera.K[:2, 2]
            longer, shorter = (
                _rectified_px(rays_of(camera, middle_px + (1 + s) * (raw_px - middle_px)), rotation, k_rectified)
                for s in (SETTINGS.focal_step, -SETTINGS.focal_step)
            )
            moved.append((longer - shorter) / (2 * SETTINGS.focal_step))
        return FocalEffect(*self._polynomials(moved))

    @cached_property
    def _places(self) -> list[tuple[_Side, NDArray[np.intp], Array]]:
        """For each side, which of the `_nodes` are inside its raw image, and where, px."""
        found = []
        for side, (camera, rotation, k_rectified) in enumerate(self._sides):
            rays = self._rays(side, self._nodes)
            ahead = np.flatnonzero(rays[:, 2] > 0)
            raw_px = project_into_image(camera, rays[ahead])
            # nodes outside were not seen
            inside = (np.abs(raw_px / (camera.width, camera.height) - 0.5) < 0.5).all(axis=1)
            found.append(((camera, rotation, k_rectified), ahead[inside], raw_px[inside]))
        return found

    @cached_property
    def _nodes(self) -> Array:
        """Positions (n, 2) px spread over a rectified image."""
        return places_over_image(self.projection, SETTINGS.nodes, SETTINGS.nodes)

    def _polynomials(self, values: Sequence[Array]) -> list[ExposedRows]:
        """Return k polynomials over both images, fitted to values (n, k) at the places of each side."""
        size = self.projection.width, self.projection.height
        x, y = (2 * self._nodes / size - 1).T
        powers = (np.vander(at, SETTINGS.degree + 1, increasing=True) for at in (x, y))
        products = np.einsum("ni,nj->nij", *powers).reshape(len(x), -1)
        fitted = [
            np.linalg.lstsq(products[at], of_side, rcond=None)[0].T
            for (_, at, _), of_side in zip(self._places, values, strict=True)
        ]
        return [
            ExposedRows(size, np.stack(sides).reshape(-1, SETTINGS.degree + 1, SETTINGS.degree + 1))
            for sides in zip(*fitted, strict=True)
        ]

    def _rectified(self, image: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
        maps = self._maps[side]
        return image if maps is None else np.asarray(cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR), np.uint8)


def _rectified_px(rays: Array, rotation: Array, k_rectified: Array) -> Array:
    """Return the positions (n, 2) px of rays (n, 3) of a camera in its rectified image."""
    turned = rays @ rotation.T @ k_rectified.T
    return np.asarray(turned[:, :2] / turned[:, 2:])


def check_rectifiable(rig: StereoRig | MonoRig) -> None:
    """Raise the RigError that a rectifier of this rig would raise, without computing its maps."""
    Rectifier(rig).check_image()


def _rectifying_rotations(rig: StereoRig | MonoRig) -> tuple[Array, ...]:
    """Return rotations (3, 3) of each camera's axes into the rectified ones. Raises RigError if not left and right."""
    if isinstance(rig, MonoRig):
        return (np.eye(3),)
    rotation, translation = rig.right_from_left[:3, :3], rig.right_from_left[:3, 3]
    right_in_left = -rotation.T @ translation
    x = right_in_left / np.linalg.norm(right_in_left)
    if x[0] < -SETTINGS.beside:
        problem = f"the right camera stands {-right_in_left[0]:.3f} m to the left of the left one"
        cure = "exchange left and right, or the sign of the baseline in the calibration"
        raise RigError(f"{problem}: {cure}", hint=("left", "right"))
    z = rotation[2] + (0, 0, 1)
    z = z - (z @ x) * x
    if np.linalg.norm(z) < SETTINGS.parallel:  # |z| is 2 for parallel cameras
        raise _not_beside(right_in_left)
    z /= np.linalg.norm(z)
    rect_from_left = np.stack([x, np.cross(z, x), z])
    return rect_from_left, rect_from_left @ rotation.T


def _not_beside(right_in_left: Array) -> RigError:
    _, y, z = right_in_left
    above = abs(y) > abs(z)
    where = ("below" if y > 0 else "above") if above else ("in front of" if z > 0 else "behind")
    cure = "turn images and calibration by 90°, or " if above else ""
    problem = f"the right camera stands {max(abs(y), abs(z)):.3f} m {where} the left one, not beside it"
    return RigError(f"{problem}: {cure}give right_from_left in axes x right, y down, z forward")


def _no_image(cameras: Sequence[Camera]) -> RigError:
    given = " and ".join(str(list(c.D)) for c in cameras)
    cure = "they must be of these cameras, in OpenCV's order"
    return RigError(f"K and the distortion coefficients {given} leave no image: {cure}")


def _extents(
    rig: StereoRig | MonoRig, cameras: Sequence[Camera], rotations: Sequence[Array]
) -> tuple[list[Array], Array]:
    """Return the extent of each camera's rectified rays and their mean span (2,). Raises RigError if there is none."""
    extents = [_extent(c, r) for c, r in zip(cameras, rotations, strict=True)]
    spans: Array = np.mean([e[1] - e[0] for e in extents], axis=0)
    if not (spans > 0).all():  # also true for NaN
        right_in_left = se3.inverse(rig.right_from_left)[:3, 3] if isinstance(rig, StereoRig) else np.eye(3)[0]
        if right_in_left[0] < SETTINGS.beside * np.linalg.norm(right_in_left):
            raise _not_beside(right_in_left)
        raise _no_image(cameras)
    return extents, spans


def _extent(camera: Camera, rotation: Array) -> Array:
    """Return the smallest and largest rectified ray (2, 2) at the middles of the image's edges."""
    w, h = camera.width - 1.0, camera.height - 1.0
    pixels = np.array([[0, h / 2], [w, h / 2], [w / 2, 0], [w / 2, h]])
    with np.errstate(invalid="ignore"):  # if the lens model has no solution, the caller reports it
        rays = rays_of(camera, pixels) @ rotation.T
    # a lens of 180° or more reaches behind the rectified plane; the focal length limits the part that is kept
    rays = rays[:, :2] / np.maximum(rays[:, 2:], SETTINGS.min_ray_depth)
    return np.array([[rays[0, 0], rays[2, 1]], [rays[1, 0], rays[3, 1]]])


def _maps(camera: Camera, rotation: Array, k_rectified: Array) -> _Maps | None:
    size = (camera.width, camera.height)
    fisheye, d = distortion(camera)
    if not (fisheye or np.any(d) or (rotation != np.eye(3)).any()):  # rectified already: corners move most
        corners = np.array([[0, 0, 1], [size[0] - 1, size[1] - 1, 1]])
        if np.abs(corners @ (camera.K @ np.linalg.inv(k_rectified)).T - corners).max() < SETTINGS.max_shift_px:
            return None
    module = cv2.fisheye if fisheye else cv2
    u, v = module.initUndistortRectifyMap(camera.K, d, rotation, k_rectified, size, cv2.CV_32FC1)
    # float32 without a grid of indices takes a fifth of the memory, which matters for images of many megapixels
    grid_u, grid_v = (np.arange(n, dtype=np.float32) for n in size)
    if max(np.abs(u - grid_u).max(), np.abs(v - grid_v[:, None]).max()) < SETTINGS.max_shift_px:
        return None
    return u, v  # with them OpenCV 5 takes 0.6 of the time of fixed-point maps, and is exact
