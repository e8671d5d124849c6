"""Keyframes: the data of a frame for recognising its place, some 60 KB whatever the size of its images.

A keyframe has ORB features with a depth from the right image, by which it is recognised from elsewhere, and patches
around points that give the exact motion: points of the engine, and features if these are few, as on bare walls.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ..frontend.templates import TemplateAtlas
from ..geometry import Array
from ..geometry.stereo import StereoProjection
from ..record import record
from .settings import SETTINGS

Image = NDArray[np.uint8]
# Edge of the stored patches, with room for warps, and the columns of their mosaic.
_SIDE_PX, _COLUMNS = TemplateAtlas.empty(1, SETTINGS.radius_px).grey.shape[1], 10


@record
class Keyframe:
    """The data of one frame; points, features and pixels are in axes of the rectified left camera.

    `frame_index`, `stamp_ns`; `odom_from_cam` (4, 4) of the engine, in physical axes. `points` (n, 3) m with
    `cov_points` (n, 3, 3) and `patches`, the JPEG of a mosaic of patches around them. `feature_px` (m, 2),
    `feature_points` (m, 3) and `descriptors` (m, 32). `depth_m`: median of the points.
    """

    frame_index: int
    stamp_ns: int
    odom_from_cam: Array
    points: NDArray[np.float32]
    cov_points: NDArray[np.float32]
    patches: bytes
    feature_px: NDArray[np.float32]
    feature_points: NDArray[np.float32]
    descriptors: NDArray[np.uint8]
    depth_m: float


def make_keyframe(
    images: Sequence[Image],
    projection: StereoProjection,
    frame_index: int,
    stamp_ns: int,
    odom_from_cam: Array,
    points: Array,
    cov_points: Array,
    valid: NDArray[np.bool_] | None = None,
) -> Keyframe:
    """Make a keyframe from rectified images and the points (n, 3) with covariances of the engine.

    `valid` (h, w): pixels of the left image that show the scene; None: all.
    """
    z = projection.project(points)
    last = projection.width - 1, projection.height - 1
    rows = np.flatnonzero((points[:, 2] > 0) & ((z[:, :2] >= 0) & (z[:, :2] <= last)).all(axis=1))
    if len(rows) > SETTINGS.max_points:
        rows = rows[np.linspace(0, len(rows) - 1, SETTINGS.max_points).astype(int)]
    points, cov_points, z = points[rows], cov_points[rows], z[rows]
    px, feature_points, descriptors = _features(images, projection, z, valid)
    depth_m = float(np.median(points[:, 2])) if len(points) else 1.0
    filled = np.linspace(0, len(px) - 1, min(len(px), SETTINGS.max_points - len(points))).astype(int)
    points = np.concatenate([points, feature_points[filled]])
    cov_points = np.concatenate([cov_points, _cov_features(projection, feature_points[filled])])
    z = np.concatenate([z[:, :2], px[filled]])
    return Keyframe(
        frame_index,
        stamp_ns,
        odom_from_cam,
        points.astype(np.float32),
        cov_points.astype(np.float32),
        _mosaic(smoothed(images[0]), z),
        px,
        feature_points,
        descriptors,
        depth_m,
    )


def smoothed(image: Image) -> NDArray[np.float32]:
    """Return the image (h, w) from which patches are cut and with which they are aligned.

    It is smoothed as in the front-end; otherwise interpolation shifts patches towards whole pixels.
    """
    return np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0), np.float32)


def are_patches(jpeg: bytes, count: int) -> bool:
    """Whether this is a mosaic of `count` patches."""
    shape = max(1, -(-count // _COLUMNS)) * _SIDE_PX, _COLUMNS * _SIDE_PX
    return count <= SETTINGS.max_points and bool(jpeg) and getattr(_decoded(jpeg), "shape", None) == shape


def _decoded(jpeg: bytes) -> NDArray[np.uint8] | None:
    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)  # type: ignore[return-value]


def templates(keyframe: Keyframe) -> TemplateAtlas:
    """Return the patches around the points, ready to be warped."""
    grey = (
        np.asarray(_decoded(keyframe.patches), np.float32)
        .reshape(-1, _SIDE_PX, _COLUMNS, _SIDE_PX)
        .transpose(0, 2, 1, 3)
    )
    return TemplateAtlas(SETTINGS.radius_px, np.ascontiguousarray(grey.reshape(-1, _SIDE_PX, _SIDE_PX)))


def _mosaic(image: NDArray[np.float32], px: Array) -> bytes:
    """Return the JPEG of patches around sub-pixel positions (n, 2)."""
    mosaic = np.zeros((max(1, -(-len(px) // _COLUMNS)), _COLUMNS, _SIDE_PX, _SIDE_PX), np.uint8)
    for k, at in enumerate(px.tolist()):
        mosaic[divmod(k, _COLUMNS)] = np.rint(cv2.getRectSubPix(image, (_SIDE_PX, _SIDE_PX), at))
    picture = mosaic.transpose(0, 2, 1, 3).reshape(-1, _COLUMNS * _SIDE_PX)
    # With this quality, recall and errors are the same as with lossless patches.
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()


def _features(
    images: Sequence[Image], projection: StereoProjection, z_px: Array, valid: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
    """Return ORB features with a depth: pixels (m, 2), points (m, 3), descriptors (m, 32).

    Flow finds them in the right image, starting from the disparity of the nearest point (n) with views `z_px`.
    """
    none = np.zeros((0, 2), np.float32), np.zeros((0, 3), np.float32), np.zeros((0, 32), np.uint8)
    # With points of the engine alone, the recall in a corridor was 0.2 instead of 1.0. The usual threshold of 20
    # grey values leaves bare walls without features.
    shown = None if valid is None else valid.astype(np.uint8)
    corners, descriptors = cv2.ORB.create(500, fastThreshold=10).detectAndCompute(images[0], shown)
    if not corners or not len(z_px):
        return none
    left = np.array([corner.pt for corner in corners], np.float32)
    nearest = np.argmin(((left[:, None] - z_px[None, :, :2]) ** 2).sum(axis=2), axis=1)
    start = left.copy()
    start[:, 0] += (z_px[:, 2] - z_px[:, 0])[nearest]
    at, status, _ = cv2.calcOpticalFlowPyrLK(
        images[0],
        images[1],
        left[:, None],
        start[:, None].copy(),
        winSize=(15, 15),
        maxLevel=1,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    right, found = np.asarray(at, np.float32)[:, 0], np.asarray(status)[:, 0] > 0
    z = np.hstack([left, right]).astype(float)
    found &= projection.inverse_depth(z) > SETTINGS.min_inverse_depth
    points = projection.triangulate(z[found])
    return left[found], points.astype(np.float32), np.asarray(descriptors, np.uint8)[found]


def _cov_features(projection: StereoProjection, points: Array) -> Array:
    """Return covariances (k, 3, 3) of triangulated points (k, 3); the flow from left to right has a σ of 0.3 px."""
    j = projection.jacobian(points.astype(float))
    return np.asarray(0.3**2 * np.linalg.inv(np.swapaxes(j, 1, 2) @ j))
