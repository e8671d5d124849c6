"""Whether two keyframes show the same place, and the motion of the camera between them, with covariance.

Features give a rough motion (PnP); patches warped by it give positions to hundredths of a pixel, as in the front-end;
the robust resection, from which every estimator starts, gives the motion and its covariance. In a corridor the
error of a loop is 13.6 mm after PnP, 6.8 mm with unwarped patches, and 2.6 mm with warped ones.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import core
from ..frontend.templates import TemplateAtlas
from ..geometry import Array, se3
from ..geometry.linear import Cholesky
from ..geometry.point_views import PointViews
from ..geometry.resection import Resection, resect
from ..geometry.stereo import MIN_DEPTH, StereoProjection
from ..geometry.view_stages import CorrectedViews
from ..motion import Motion
from ..record import record
from .keyframes import Image, Keyframe, smoothed, templates
from .settings import SETTINGS


@record
class Seen:
    """The newest keyframe with its rectified images."""

    keyframe: Keyframe
    images: Sequence[Image]


class Verifier:
    """Verifies places for one rig."""

    def __init__(self, projection: StereoProjection) -> None:
        self._projection = p = projection
        self._matrix = np.array([[p.f_px, 0, p.cx_left_px], [0, p.f_px, p.cy_px], [0, 0, 1]])

    def motion(self, old: Keyframe, new: Seen, predicted: Array | None = None) -> Motion | None:
        """Return the motion from the old keyframe to the new one, in rectified axes; None if their places differ.

        If too few features match, the patches are warped by the motion `predicted`, if there is one.
        """
        start = self._rough(old, new.keyframe)
        if start is None and predicted is not None:
            start = se3.inverse(predicted)
        if start is None or not len(old.points):
            return None
        images, atlas = [smoothed(image) for image in new.images], templates(old)
        for _ in range(SETTINGS.passes):
            refined = self._refined(old, atlas, images, start)
            if refined is None:
                return None
            views, found = refined
            start = found.cam_from_ref
        if found.accepted.sum() < SETTINGS.min_views or found.ambiguous is not None:
            return None
        motion = se3.inverse(found.cam_from_ref)
        far = np.linalg.norm(motion[:3, 3]) > SETTINGS.max_offset_depths * old.depth_m
        if far or np.linalg.norm(se3.log_so3(motion[:3, :3])) > SETTINGS.max_angle_rad:
            return None
        factor = max(1.0, found.chi2 / max(found.dof, 1), _halves_apart(views, found))
        return Motion(motion, found.cov_pose * factor)

    def _rough(self, old: Keyframe, new: Keyframe) -> Array | None:
        """Return the new camera from the old one, by PnP of matched features."""
        pairs = matches(old.descriptors, new.descriptors)
        if len(pairs) < SETTINGS.min_views:
            return None
        points = old.feature_points[pairs[:, 0]].astype(float)
        px = new.feature_px[pairs[:, 1]].astype(float)
        ok, rotation, translation, inliers = cv2.solvePnPRansac(
            points,
            px,
            self._matrix,
            None,
            iterationsCount=200,
            reprojectionError=3.0,
            confidence=0.999,
            flags=cv2.SOLVEPNP_AP3P,
        )
        if not ok or inliers is None or len(inliers) < SETTINGS.min_views:
            return None
        new_from_old = se3.exp(np.zeros(6))
        new_from_old[:3, :3] = se3.exp_so3(rotation[:, 0])
        new_from_old[:3, 3] = translation[:, 0]
        return new_from_old

    def _refined(
        self, old: Keyframe, atlas: TemplateAtlas, images: Sequence[NDArray[np.float32]], new_from_old: Array
    ) -> tuple[PointViews, Resection] | None:
        """Return views and motion from patches that are warped by a rough motion."""
        p = self._projection
        points = old.points.astype(float)
        here = se3.transform(new_from_old, points)
        ahead = here[:, 2] > MIN_DEPTH
        z = p.project(np.where(ahead[:, None], here, (0.0, 0.0, 1.0)))
        warps = self._old_from_new(points, new_from_old)
        margin = SETTINGS.radius_px + 1
        visible = ahead & (z[:, 0] > margin) & (z[:, 0] < p.width - margin)
        visible &= (z[:, 1] > margin) & (z[:, 1] < p.height - margin)
        visible &= atlas.fits(warps)
        rows = np.flatnonzero(visible)
        if len(rows) < SETTINGS.min_views:
            return None
        patches = atlas.warped(rows, warps[rows])
        z = z[rows]
        left, found, _ = patches.align(images[0], z[:, :2])
        right, both, _ = patches.align(images[1], left + z[:, 2:] - z[:, :2])
        views = CorrectedViews(np.hstack([left, np.where(both[:, None], right, np.nan)])[found])
        rows = rows[found]
        if len(rows) < SETTINGS.min_views:
            return None
        cov_px = np.broadcast_to(SETTINGS.std_px**2 * np.eye(4), (len(rows), 4, 4))
        of_points = PointViews(p, points[rows], old.cov_points[rows].astype(float), views, cov_px)
        motion = resect(of_points, new_from_old)
        return (of_points, motion) if motion.ok and self._is_spread(views[motion.accepted]) else None

    def _old_from_new(self, points: Array, new_from_old: Array) -> Array:
        """Return warps (n, 3, 2) of pixel offsets for surfaces that face the old camera; useless if seen edge-on."""
        step = points[:, 2] / self._projection.f_px
        shifted = np.stack([points, *(points + step[:, None] * axis for axis in np.eye(3)[:2])])
        here = se3.transform(new_from_old, shifted)
        z = self._projection.f_px * here[..., :2] / np.maximum(here[..., 2:], MIN_DEPTH)
        new_from_old_px = np.stack([z[1] - z[0], z[2] - z[0]], axis=2)
        edge_on = 1e-3  # area of a pixel of the old view in the new one
        new_from_old_px[np.abs(np.linalg.det(new_from_old_px)) < edge_on] = edge_on * np.eye(2)
        return np.concatenate([np.linalg.inv(new_from_old_px), np.zeros((len(points), 1, 2))], axis=1)

    def _is_spread(self, z_px: Array) -> bool:
        """Whether views (n, 4) cover enough of the image."""
        cells = (4 * z_px[:, :2] / (self._projection.width, self._projection.height)).astype(int)
        return len(np.unique(cells[:, 0] + 4 * cells[:, 1])) >= SETTINGS.min_cells


def _halves_apart(views: PointViews, found: Resection) -> float:
    """Return the squared distance of motions from two halves of the views over its expected value, six.

    It is the largest of near and far, left and right, upper and lower halves: patches on slanted surfaces share errors
    within one of these. With N and g the information and the right-hand side of a half, and M that of all, whose
    right-hand side is zero, the distance is gᵀ (N − N M⁻¹ N)⁻¹ g.
    """
    used = views.select(found.accepted)
    root, jacobian = used.linearise(found.cam_from_ref)
    residuals = core.view_residuals(used, root, np.zeros(0), found.cam_from_ref[None])[0][0]
    information = np.swapaxes(jacobian, 1, 2) @ jacobian
    right = (residuals[:, None] @ jacobian)[:, 0]
    rest, apart = Cholesky(information.sum(axis=0)), 0.0
    for along in (used.points[:, 2] / used.points[:, 3], used.z_px[:, 0], used.z_px[:, 1]):
        half = along > np.median(along)
        n, g = information[half].sum(axis=0), right[half].sum(axis=0)
        apart = max(apart, float(g @ Cholesky(n - n @ rest.solve(n)).solve(g)))
    return apart / 6


def matches(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Return pairs (k, 2) of descriptors: of a with the nearest of b, if clearly nearer than the second; each once."""
    if len(a) < 2 or len(b) < 2:
        return np.zeros((0, 2), np.intp)
    bits, nearest = cv2.batchDistance(a, b, cv2.CV_32S, None, None, cv2.NORM_HAMMING, 2)
    rows = np.flatnonzero(bits[:, 0] < SETTINGS.max_ratio * bits[:, 1])
    rows = rows[np.argsort(bits[rows, 0], kind="stable")]
    rows = np.sort(rows[np.unique(nearest[rows, 0], return_index=True)[1]])
    return np.stack([rows, nearest[rows, 0]], axis=1)
