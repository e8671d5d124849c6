"""Checks a calibration against images: matched corners must lie on one row once rectified."""

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from ..camera.lens import rays_of
from ..camera.models import Camera
from ..camera.rig import StereoRig
from ..geometry.medians import MAD_TO_STD, median
from ..geometry.se3 import Array
from ..record import record

_FEATURES = 1000  # ORB corners per image: some hundred of them match in an ordinary scene
_MAX_HAMMING = 40  # of 256 bits between two ORB descriptors that match; random ones differ by 128 ± 8
_WINDOW_PX = (15, 15)  # patch of the sub-pixel refinement
# ORB corners are whole pixels of their pyramid level, the last of which has pixels of 3.6 px
_MAX_REFINEMENT_PX = 3.0
_MIN_MATCHES = 40  # in all frames together: fewer say nothing certain about rows
_MIN_FRAME_MATCHES = 8  # in one frame
_INLIER_SPREADS, _MIN_INLIER_PX = 3.0, 1.0  # matches within 3 σ of the median row offset, but never less than 1 px
_INLIER_ROUNDS = 6  # of median and spread, enough to settle
_NEGATIVE_PX = -1.0  # disparities below it are negative beyond the noise of a match

Images = tuple[NDArray[np.uint8], NDArray[np.uint8]]  # left, right, (h, w)
Corners = tuple[Array, Array]  # pixels (n, 2) of corners in the left image and in the right one


@record
class CalibrationCheck:
    """The matches of a few frames in pixels of rectified images; NaN where there are too few.

    `vertical_px`: median of left minus right row, with `vertical_spread_px`; `negative_share`: of the matches whose
    disparity is negative, as none can be where left is left.
    """

    matches: int
    vertical_px: float
    vertical_spread_px: float
    negative_share: float
    median_disparity_px: float

    @property
    def row_error_px(self) -> float:
        """How far matched corners are from lying on one row; infinite where there are too few matches."""
        return float(np.nan_to_num(np.hypot(self.vertical_px, self.vertical_spread_px), nan=np.inf))


def check_calibration(rig: StereoRig, frames: Iterable[Corners]) -> CalibrationCheck:
    """Compare the rows that a calibration gives to corners that were matched without it, of a few frames."""
    rotation_left, rotation_right = _rectifying_rotations(rig)
    focal_px = float(rig.left.K[0, 0])
    rows: list[Array] = []
    disparities: list[Array] = []
    for left_px, right_px in frames:
        if len(left_px) < _MIN_FRAME_MATCHES:
            continue
        left = _rectified(rig.left, rotation_left, left_px)
        right = _rectified(rig.right, rotation_right, right_px)
        offset = focal_px * (left - right)
        good = np.isfinite(offset).all(axis=1)
        rows.append(offset[good, 1])
        disparities.append(offset[good, 0])
    vertical = np.concatenate(rows) if rows else np.empty(0)
    disparity = np.concatenate(disparities) if disparities else np.empty(0)
    # Wrong matches lie anywhere: keep those that agree on one vertical offset.
    centre, spread = 0.0, 0.1 * rig.left.height
    for _ in range(_INLIER_ROUNDS):
        good = np.abs(vertical - centre) < max(_INLIER_SPREADS * spread, _MIN_INLIER_PX)
        if good.sum() < _MIN_MATCHES:
            return CalibrationCheck(int(good.sum()), np.nan, np.nan, np.nan, np.nan)
        centre = median(vertical[good])
        spread = MAD_TO_STD * median(np.abs(vertical[good] - centre))
    disparity = disparity[good]
    negative = float(np.mean(disparity < _NEGATIVE_PX))
    return CalibrationCheck(int(good.sum()), centre, spread, negative, median(disparity))


def matched_corners(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Corners:
    """Match corners between left and right without any calibration."""
    orb = cv2.ORB.create(_FEATURES)
    left_keys, left_words = orb.detectAndCompute(left, None)
    right_keys, right_words = orb.detectAndCompute(right, None)
    if left_words is None or right_words is None:
        return np.empty((0, 2)), np.empty((0, 2))
    found = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(left_words, right_words)
    found = [m for m in found if m.distance < _MAX_HAMMING]
    if not found:
        return np.empty((0, 2)), np.empty((0, 2))
    left_px = np.array([left_keys[m.queryIdx].pt for m in found], np.float32)
    coarse_px = np.array([right_keys[m.trainIdx].pt for m in found], np.float32)
    # Corners are whole pixels of their scale; the patch around them is located to a tenth of a pixel.
    fine_px, found_again, _ = cv2.calcOpticalFlowPyrLK(
        left, right, left_px, coarse_px.copy(), winSize=_WINDOW_PX, maxLevel=1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    good = (found_again[:, 0] == 1) & (np.abs(fine_px - coarse_px).max(axis=1) < _MAX_REFINEMENT_PX)
    return left_px[good].astype(float), fine_px[good].astype(float)


def _rectifying_rotations(rig: StereoRig) -> tuple[Array, Array]:
    """Rotations (3, 3) of left and right camera axes into axes whose x runs along the baseline."""
    rotation = rig.right_from_left[:3, :3]
    right_in_left = -rotation.T @ rig.right_from_left[:3, 3]
    x = right_in_left / np.linalg.norm(right_in_left)
    if x[0] < 0:
        x = -x  # keep the image upright where the baseline has the wrong sign
    z = np.array([0.0, 0.0, 1.0]) + rotation[2]  # the mean of both optical axes
    y = np.cross(z, x)
    y /= np.linalg.norm(y)
    from_left = np.stack([x, y, np.cross(x, y)])
    return from_left, from_left @ rotation.T


def _rectified(camera: Camera, rotation: Array, points_px: Array) -> Array:
    """Normalised rectified coordinates (n, 2) of pixels (n, 2)."""
    rays = rays_of(camera, points_px) @ rotation.T
    return np.where(rays[:, 2:] > 0.05, rays[:, :2] / np.maximum(rays[:, 2:], 0.05), np.nan)
