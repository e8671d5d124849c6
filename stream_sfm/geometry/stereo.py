"""The rectified camera pair: projection, its Jacobian, triangulation with covariance.

A stereo view of a point is z = (u_left, v_left, u_right, v_right) in pixels of the rectified images. The two
rectified cameras share focal length, row and axes; the right one stands `baseline_m` along +x.
"""

from dataclasses import dataclass

import numpy as np

from .. import core
from .se3 import Array

# Points are kept at least this far in front of the camera plane before projection: metres for a Euclidean point,
# the depth relative to that of the anchor for a homogeneous one. It is smaller than any depth that a lens can
# image; only wild steps and points behind the camera reach it.
MIN_DEPTH = core.MIN_DEPTH
# Limits of an inverse depth in its standard deviations. Below the first, the depth is not Gaussian in metres. Points at
# infinity are accepted down to the second; values below it are wrong matches.
KNOWN_DEPTH_SIGMAS, MIN_INVERSE_DEPTH_SIGMAS = 3.0, -2.0


@dataclass(frozen=True, slots=True)
class StereoProjection:
    """The projection of a rectified pair, in pixels; `baseline_m` > 0.

    `cx_left_px` and `cx_right_px` may differ: converging cameras keep their common field of view that way.
    `virtual_right`: there is only one camera, and `baseline_m` is in units of its first motion.
    """

    f_px: float
    cx_left_px: float
    cx_right_px: float
    cy_px: float
    baseline_m: float
    width: int
    height: int
    virtual_right: bool = False

    def project(self, points_in_cam: Array) -> Array:
        """Return z (…, 4) of points (…, 3), eq. (8); the caller keeps points in front of the camera (Z > 0)."""
        x, y, depth = points_in_cam[..., 0], points_in_cam[..., 1], points_in_cam[..., 2]
        s = self.f_px / depth
        z = np.empty((*points_in_cam.shape[:-1], 4))
        z[..., 0] = s * x + self.cx_left_px
        z[..., 1] = z[..., 3] = s * y + self.cy_px
        z[..., 2] = s * (x - self.baseline_m) + self.cx_right_px
        return z

    def jacobian(self, points_in_cam: Array) -> Array:
        """Return A = ∂z/∂X (…, 4, 3) at points (…, 3), eq. (9)."""
        x, y, depth = points_in_cam[..., 0], points_in_cam[..., 1], points_in_cam[..., 2]
        s = self.f_px / depth
        a = np.zeros((*points_in_cam.shape[:-1], 4, 3))
        a[..., 0, 0] = a[..., 1, 1] = a[..., 2, 0] = a[..., 3, 1] = s
        a[..., 0, 2] = -s * x / depth
        a[..., 1, 2] = a[..., 3, 2] = -s * y / depth
        a[..., 2, 2] = -s * (x - self.baseline_m) / depth
        return a

    def project_homogeneous(self, points: Array) -> Array:
        """Return z (…, 4) of homogeneous points (X, Y, Z, ρ) in the camera, (…, 4); ρ = 0 is a point at infinity."""
        return core.project_points(self, points.reshape(-1, 4)).reshape(points.shape)

    def depth_m(self, z_px: Array) -> Array:
        """Return the depth (…) m from the disparity of z (…, 4); infinite or negative if it is not positive."""
        disparity = (z_px[..., 0] - self.cx_left_px) - (z_px[..., 2] - self.cx_right_px)
        with np.errstate(divide="ignore"):
            return self.f_px * self.baseline_m / disparity

    def inverse_depth(self, z_px: Array) -> Array:
        """Return 1/Z (…), 1/m, from the disparity of z (…, 4), eq. (10); 0 at infinity, NaN without the right side."""
        disparity = (z_px[..., 0] - self.cx_left_px) - (z_px[..., 2] - self.cx_right_px)
        return disparity / (self.f_px * self.baseline_m)

    def rays(self, z_px: Array) -> Array:
        """Return (X/Z, Y/Z) (…, 2) of the left side of views (…, 2 or 4)."""
        return (z_px[..., :2] - (self.cx_left_px, self.cy_px)) / self.f_px

    def triangulate(self, z_px: Array) -> Array:
        """Return points (…, 3) of stereo views (…, 4): exact when the two rows agree, their mean otherwise."""
        depth = self.depth_m(z_px)
        x = (z_px[..., 0] - self.cx_left_px) * depth / self.f_px
        y = (0.5 * (z_px[..., 1] + z_px[..., 3]) - self.cy_px) * depth / self.f_px
        return np.stack([x, y, depth], axis=-1)


def velocities(projection: StereoProjection, points_in_cam: Array, twist: Array) -> Array:
    """Return the velocities (n, 4), px/s, of views of homogeneous points (n, 4) with a twist (6,), or one each."""
    return core.velocities(projection, points_in_cam, twist.reshape(-1, 6))


def places_over_image(projection: StereoProjection, down: int, across: int) -> Array:
    """Return `down` × `across` positions (n, 2) spread over the left image, row by row."""
    u, v = np.linspace(0, projection.width - 1, across), np.linspace(0, projection.height - 1, down)
    return np.stack(np.meshgrid(u, v), axis=2).reshape(-1, 2)


def clamp_depth(points_in_cam: Array) -> Array:
    """Return a copy of points (…, 3 or 4) whose third coordinate is at least MIN_DEPTH."""
    points = points_in_cam.copy()
    np.maximum(points[..., 2], MIN_DEPTH, out=points[..., 2])
    return points


def information_of_views(z_px: Array, cov_px: Array) -> Array:
    """Return the information (…, 4, 4) of views with covariance (…, 4, 4); zero for a side that is NaN in z."""
    seen = np.isfinite(z_px)
    both = seen[..., :, None] & seen[..., None, :]
    cov = np.where(both, cov_px, np.eye(4))
    return np.where(both, np.linalg.inv(cov), 0.0)
