"""Any calibrated pair to a rectified one: common focal length and rows, the baseline along +x.

The rectified axes are our own choice from `right_from_left` (x along the baseline, z between the two optical axes),
whatever rectification a log proposes; poses are handed out in the physical left camera's axes again.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import RigError
from ..geometry.pose import Array
from ..geometry.stereo import StereoProjection
from ..types import Camera, StereoRig

# A wider view than the lens centre's own scale is bought with resolution; not below this share of it.
_MIN_FOCAL_SHARE = 0.9


class Rectifier:
    """`projection` of the rectified pair; `rect_from_cam` (3, 3): its axes from the physical left camera's.

    Raises RigError where left and right are exchanged, or where the calibration leaves no image.
    """

    def __init__(self, rig: StereoRig) -> None:
        rotation, translation = rig.right_from_left[:3, :3], rig.right_from_left[:3, 3]
        right_in_left = -rotation.T @ translation
        x = right_in_left / np.linalg.norm(right_in_left)
        if x[0] < -0.5:
            raise RigError(
                f"the right camera stands {-right_in_left[0]:.3f} m to the left of the left one: "
                "exchange left and right (--left, --right), or the sign of the baseline in the calibration"
            )
        z = rotation[2] + (0, 0, 1)
        z = z - (z @ x) * x
        z /= np.linalg.norm(z)
        self.rect_from_cam: Array = np.stack([x, np.cross(z, x), z])
        rotations = (self.rect_from_cam, self.rect_from_cam @ rotation.T)
        cameras = (rig.left, rig.right)
        width, height = rig.left.width, rig.left.height
        extents = [_extent(c, r) for c, r in zip(cameras, rotations, strict=True)]
        f_lens = float(np.mean([c.K[[0, 1], [0, 1]] for c in cameras]))
        spans = np.mean([e[1] - e[0] for e in extents], axis=0)
        if not (spans > 0).all():  # false for NaN too
            raise RigError(
                f"K and the distortion coefficients {list(rig.left.D)} and {list(rig.right.D)} leave no image: "
                "are they of these cameras, in OpenCV's order?"
            )
        f_fit = float(min((width - 1) / spans[0], (height - 1) / spans[1]))
        f = f_lens if f_fit > 0.999 * f_lens else max(f_fit, _MIN_FOCAL_SHARE * f_lens)
        middle = [(e[0] + e[1]) / 2 for e in extents]
        cx = [(width - 1) / 2 - f * m[0] for m in middle]
        cy = (height - 1) / 2 - f * (middle[0][1] + middle[1][1]) / 2
        self.projection = StereoProjection(f, cx[0], cx[1], cy, rig.baseline_m, width, height)
        self._maps = [_maps(c, r, f, cx[i], cy) for i, (c, r) in enumerate(zip(cameras, rotations, strict=True))]
        self.valid: NDArray[np.bool_] = np.ones((height, width), bool)
        self.valid &= self._rectified(np.full((height, width), 255, np.uint8), 0) == 255

    def rectify(self, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
        """Left and right images (h, w) uint8, rectified; the same arrays where nothing has to move."""
        return [self._rectified(left, 0), self._rectified(right, 1)]

    def _rectified(self, image: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
        maps = self._maps[side]
        return image if maps is None else np.asarray(cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR), np.uint8)


def _distortion(camera: Camera) -> tuple[bool, Array]:
    """Whether the lens is a fisheye (also one whose coefficients are all zero), and its coefficients for OpenCV."""
    fisheye = camera.distortion_model == "equidistant"
    return fisheye, np.array(camera.D if any(camera.D) else (0.0,) * 4)


def _extent(camera: Camera, rotation: Array) -> Array:
    """Smallest and largest rectified ray (2, 2) that the middles of the image's edges reach."""
    w, h = camera.width - 1.0, camera.height - 1.0
    pixels = np.array([[0, h / 2], [w, h / 2], [w / 2, 0], [w / 2, h]])
    fisheye, d = _distortion(camera)
    rays = (cv2.fisheye if fisheye else cv2).undistortPoints(pixels[:, None], camera.K, d)[:, 0]
    with np.errstate(invalid="ignore"):  # where the lens model has no answer, the caller says so
        rays = np.concatenate([rays, np.ones((4, 1))], axis=1) @ rotation.T
    # a lens of 180° and more reaches behind the rectified plane; the focal share bounds what is kept of it
    rays = rays[:, :2] / np.maximum(rays[:, 2:], 0.2)
    return np.array([[rays[0, 0], rays[2, 1]], [rays[1, 0], rays[3, 1]]])


def _maps(camera: Camera, rotation: Array, f: float, cx: float, cy: float) -> tuple | None:
    k = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])
    size = (camera.width, camera.height)
    fisheye, d = _distortion(camera)
    module = cv2.fisheye if fisheye else cv2
    u, v = module.initUndistortRectifyMap(camera.K, d, rotation, k, size, cv2.CV_32FC1)
    # float32 without a grid of indices: a fifth of the memory, which counts for images of many megapixels
    grid_u, grid_v = (np.arange(n, dtype=np.float32) for n in size)
    if max(np.abs(u - grid_u).max(), np.abs(v - grid_v[:, None]).max()) < 1e-2:
        return None
    return cv2.convertMaps(u, v, cv2.CV_16SC2)
