"""Points as q = (X/Z, Y/Z, 1/Z) in the camera that first saw them, and the linearised stereo views of many frames.

In these coordinates a stereo view is nearly linear, so a Gaussian over q stays valid for far points, a point at
infinity is an ordinary one, and so is a point beside or behind the current camera. The camera that first saw a point is
its anchor. Homogeneous points in the reference camera are C (q₁, q₂, 1, q₃)ᵀ with C = ref_from_anchor, eq. (24): a
known pose, a choice of coordinates and not part of the state. A frame s with pose X_s = cam_s_from_ref sees
P = X_s C (q₁, q₂, 1, q₃)ᵀ. A pose is perturbed as Exp(ξ) X_s (left), which is the right perturbation −ξ of
ref_from_cam_s. Arrays are batched: F frames, P points, V views.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry.linear import matvec, symmetric_inverse
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from ...record import record, rows_of
from ...rig_model.model import RigEffects

Q_COLUMNS = np.array([0, 1, 3])  # of a homogeneous point: what q moves


def homogeneous_from_q(q: Array) -> Array:
    """Return homogeneous points (…, 4) of q (…, 3) in the anchor."""
    return np.stack([q[..., 0], q[..., 1], np.ones(q.shape[:-1]), q[..., 2]], axis=-1)


def in_reference(ref_from_anchor: Array, q: Array) -> Array:
    """Return homogeneous points (P, 4) in the reference camera of q (P, 3); `ref_from_anchor` (P, 4, 4)."""
    return matvec(ref_from_anchor, homogeneous_from_q(q))


def q_of_views(projection: StereoProjection, z_px: Array) -> Array:
    """Return q (n, 3) of stereo views (n, 4) in the camera that saw them; the row is the mean of both."""
    v = 0.5 * (z_px[:, 1] + z_px[:, 3])
    x, y = (z_px[:, 0] - projection.cx_left_px) / projection.f_px, (v - projection.cy_px) / projection.f_px
    return np.stack([x, y, projection.inverse_depth(z_px)], axis=1)


def q_jacobian(points: Array) -> Array:
    """Return ∂q/∂P (…, 3, 4) at homogeneous points (…, 4)."""
    k = np.zeros((*points.shape[:-1], 3, 4))
    inv = 1 / points[..., 2]
    k[..., 0, 0] = k[..., 1, 1] = k[..., 2, 3] = inv
    k[..., :, 2] = -points[..., Q_COLUMNS] * (inv * inv)[..., None]
    return k


@record
class WhitenedViews:
    """The views of a window as flat rows.

    `frame` (V,) and `point` (V,) are indices from 0, each pair at most once; `z_px` (V, 4) finite; `root`
    (V, 4, 4) whitens a residual: RᵀR is the information that counts, with zero rows for a side that is missing;
    `weight` (V, 4): the square root of its share in what the view itself has, coordinate by coordinate. `rig_effects`:
    of the rig's errors, which are part of what a view shows.
    """

    frame: NDArray[np.intp]
    point: NDArray[np.intp]
    z_px: Array
    root: Array
    weight: Array
    rig_effects: RigEffects

    @classmethod
    def none(cls, rig_errors: int = 0) -> "WhitenedViews":
        """Return no views."""
        none = np.empty(0, np.intp)
        empty = np.empty((0, 4))
        effects = RigEffects(np.empty((0, 4, rig_errors)), np.empty((0, 0)))
        return cls(none, none, empty, np.empty((0, 4, 4)), empty, effects)

    @classmethod
    def concatenate(cls, parts: Sequence["WhitenedViews"]) -> "WhitenedViews":
        """Return the views of several frames, of one at least."""
        *names, effects = (f.name for f in fields(cls))
        joined: dict[str, Any] = {name: np.concatenate([getattr(p, name) for p in parts]) for name in names}
        joined[effects] = RigEffects.concatenate([p.rig_effects for p in parts])
        return cls(**joined)

    def __getitem__(self, rows: NDArray[np.intp] | slice) -> "WhitenedViews":
        return WhitenedViews(
            frame=rows_of(self.frame, rows),
            point=rows_of(self.point, rows),
            z_px=rows_of(self.z_px, rows),
            root=rows_of(self.root, rows),
            weight=rows_of(self.weight, rows),
            rig_effects=self.rig_effects[rows],
        )

    def of_map(self, ids: NDArray[np.int64]) -> "WhitenedViews":
        """Return the same views, whose points were given by ids, with indices in `ids` (ascending)."""
        return replace(self, point=np.searchsorted(ids, self.point))

    def of_core(self) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array, Array, Array, Array]:
        """Return the arrays that the compiled core takes."""
        effects = self.rig_effects
        return self.frame, self.point, self.z_px, self.root, effects.terms, effects.field, effects.moves

    def of_points(self, points: NDArray[np.intp]) -> "WhitenedViews":
        """Return the views of the points with these indices (n,), ascending, which are counted anew from 0."""
        at = np.minimum(np.searchsorted(points, self.point), max(len(points) - 1, 0))
        rows = np.flatnonzero(points[at] == self.point) if len(points) else np.empty(0, np.intp)
        return replace(self[rows], point=at[rows])


@record
class NormalBlocks:
    """The normal equations of all views, eq. (26): blocks of the poses, of the points, and between them.

    `u` (F, 6, 6), `v` (P, 3, 3), `w` (P, 3, 6F); right-hand sides `g_pose` (F, 6), `g_point` (P, 3). Of the rig's
    errors `rig` (m, m), with the poses `rig_pose` (F, 6, m), with the points `rig_point` (P, 3, m), and `g_rig` (m,).
    """

    u: Array
    v: Array
    w: Array
    g_pose: Array
    g_point: Array
    rig: Array
    rig_pose: Array
    rig_point: Array
    g_rig: Array

    def points_alone(self, q: Array, rig_step: Array) -> tuple[Array, Array, Array]:
        """Return the points by these views alone: mean (P, 3), covariance (P, 3, 3), and ∂q by the rig's errors.

        `q` (P, 3): where they were linearised; the mean is that with errors of the rig that are off by (m,) from there.
        """
        cov = symmetric_inverse(self.v)
        by_rig = -cov @ self.rig_point
        return q + matvec(cov, self.g_point) + by_rig @ rig_step, cov, by_rig


def whitened_residuals(
    projection: StereoProjection,
    cams_from_ref: Array,
    ref_from_anchor: Array,
    q: Array,
    rig_error: Array,
    views: WhitenedViews,
) -> Array:
    """Return the whitened residuals (V, 4) of views.

    `cams_from_ref` (F, 4, 4), `ref_from_anchor` (P, 4, 4), q (P, 3), `rig_error` (m,).
    """
    return core.window_residuals(
        projection.pinholes, cams_from_ref, ref_from_anchor, q, rig_error, *views.of_core()
    )


def linearise(
    projection: StereoProjection,
    cams_from_ref: Array,
    ref_from_anchor: Array,
    q: Array,
    rig_error: Array,
    views: WhitenedViews,
) -> NormalBlocks:
    """Return the Gauss-Newton normal equations of all views, eqs. (25), (26) and (71)."""
    return NormalBlocks(
        *core.normal_blocks(projection.pinholes, cams_from_ref, ref_from_anchor, q, rig_error, *views.of_core())
    )
