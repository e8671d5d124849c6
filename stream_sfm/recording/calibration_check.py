"""Does the calibration fit the images? Matched corners must lie on one row once lens and vergence are taken out."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from ..geometry.pose import Array
from ..types import Camera, StereoFrame, StereoRig

_MIN_MATCHES = 40
_FEATURES = 1500


@dataclass(frozen=True, slots=True)
class CalibrationCheck:
    """Over the matches of a few frames, in pixels of rectified images: `vertical_px` is left minus right row.

    `negative_share`: share of matches whose disparity is negative, as none can be if left is left. NaN where
    there are too few matches.
    """

    matches: int
    vertical_px: float
    vertical_spread_px: float
    negative_share: float
    median_disparity_px: float


def check_calibration(rig: StereoRig, frames: Iterable[StereoFrame]) -> CalibrationCheck:
    """Match corners between left and right without using the calibration, then look where it puts them."""
    rotation_left, rotation_right = _rectifying_rotations(rig)
    focal_px = float(rig.left.K[0, 0])
    rows: list[Array] = []
    disparities: list[Array] = []
    for frame in frames:
        left_px, right_px = _matches(frame)
        if len(left_px) < 8:
            continue
        left = _rectified(rig.left, rotation_left, left_px)
        right = _rectified(rig.right, rotation_right, right_px)
        offset = focal_px * (left - right)
        good = np.isfinite(offset).all(axis=1)
        rows.append(offset[good, 1])
        disparities.append(offset[good, 0])
    vertical = np.concatenate(rows) if rows else np.empty(0)
    disparity = np.concatenate(disparities) if disparities else np.empty(0)
    # Wrong matches lie anywhere: keep what agrees on one vertical offset.
    centre, spread = 0.0, 0.1 * rig.left.height
    for _ in range(6):
        good = np.abs(vertical - centre) < max(3 * spread, 1.0)
        if good.sum() < _MIN_MATCHES:
            return CalibrationCheck(int(good.sum()), np.nan, np.nan, np.nan, np.nan)
        centre = float(np.median(vertical[good]))
        spread = 1.4826 * float(np.median(np.abs(vertical[good] - centre)))
    disparity = disparity[good]
    negative = float(np.mean(disparity < -1.0))
    return CalibrationCheck(int(good.sum()), centre, spread, negative, float(np.median(disparity)))


def findings(rig: StereoRig, check: CalibrationCheck) -> tuple[list[str], list[str]]:
    """(problems, warnings): what makes stereo impossible, and what makes it worse. Each says what to change."""
    problems, warnings = [], []
    for name, camera in (("left", rig.left), ("right", rig.right)):
        cx, cy = camera.K[0, 2], camera.K[1, 2]
        if abs(cx / camera.width - 0.5) > 0.25 or abs(cy / camera.height - 0.5) > 0.25:
            problems.append(
                f"the {name} principal point ({cx:.0f}, {cy:.0f}) is far from the centre of {camera.width}×"
                f"{camera.height} images: K seems to belong to images of about {2 * cx:.0f}×{2 * cy:.0f}; scale K "
                "with the images"
            )
    if not np.isfinite(check.vertical_px):
        warnings.append(f"the calibration could not be checked: only {check.matches} corners match left to right")
        return problems, warnings
    if check.negative_share > 0.5:
        problems.append(
            f"{100 * check.negative_share:.0f} % of the matches have negative disparity: left and right are "
            "swapped; swap them with --left and --right"
        )
    if abs(check.vertical_px) > 2 or check.vertical_spread_px > 3:
        problems.append(
            f"matched corners differ by {check.vertical_px:+.2f} ± {check.vertical_spread_px:.2f} px in their row: "
            "the calibration does not belong to these images"
        )
    elif abs(check.vertical_px) > 0.5 or check.vertical_spread_px > 1.2:
        warnings.append(
            f"matched corners differ by {check.vertical_px:+.2f} ± {check.vertical_spread_px:.2f} px in their row: "
            "the calibration is not accurate, or the cameras are not triggered together"
        )
    return problems, warnings


def _matches(frame: StereoFrame) -> tuple[Array, Array]:
    orb = cv2.ORB.create(_FEATURES)
    left_keys, left_words = orb.detectAndCompute(frame.left, None)
    right_keys, right_words = orb.detectAndCompute(frame.right, None)
    if left_words is None or right_words is None:
        return np.empty((0, 2)), np.empty((0, 2))
    found = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(left_words, right_words)
    found = [m for m in found if m.distance < 40]
    left = np.array([left_keys[m.queryIdx].pt for m in found], dtype=float).reshape(-1, 2)
    right = np.array([right_keys[m.trainIdx].pt for m in found], dtype=float).reshape(-1, 2)
    return left, right


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
    points = points_px.reshape(-1, 1, 2)
    d = np.array(camera.D) if camera.D else np.zeros(4)
    if camera.distortion_model == "equidistant":
        flat = cv2.fisheye.undistortPoints(points, camera.K, d)
    else:
        flat = cv2.undistortPoints(points, camera.K, d)
    rays = np.concatenate([flat.reshape(-1, 2), np.ones((len(points_px), 1))], axis=1) @ rotation.T
    return np.where(rays[:, 2:] > 0.05, rays[:, :2] / np.maximum(rays[:, 2:], 0.05), np.nan)
