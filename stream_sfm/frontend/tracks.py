"""The table of live tracks: one row per point, ascending ids."""

from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array
from ..geometry.stereo import MIN_DEPTH, StereoProjection, velocities
from ..record import changed, columns_at, record
from .rules import MotionRules


@record
class Tracks:
    """A table with one array per column and one row (n) per track.

    `ids`; `slots` of the templates; `left_px` (n, 2): the last measured left position, with `cov_left_px` (n, 2, 2).
    `points` (n, 4): homogeneous (X/Z, Y/Z, 1, 1/Z) in the current rectified camera, and `var_rho` of the inverse depth.
    The anchor is the frame in which the template was cut. `anchor_from_start` (n, 4, 4): its pose in the front-end's
    own chain of motions; `anchor_rays` (n, 2): (X/Z, Y/Z) of the template's centre, exact by definition;
    `anchor_velocity_px_s` (n, 2): its velocity in the left image; `slopes` (n, 2): ∂(1/Z)/∂(X/Z, Y/Z) of the surface,
    1/m; `scale` (n,): image pixels per pixel of the template, 1 or `WIDE`; `exposures` (n, 2): gain and offset of grey
    values in the last left image over those of the template; `contrast` (n,): of the patch there over that of the
    template, relative to the mean grey values, NaN before the second view. `agreed` (n,): in how many frames the track
    agreed with the motion, halved each time it did not.
    """

    ids: NDArray[np.int64]
    slots: NDArray[np.intp]
    left_px: Array
    cov_left_px: Array
    points: Array
    var_rho: Array
    anchor_from_start: Array
    anchor_rays: Array
    anchor_velocity_px_s: Array
    slopes: Array
    exposures: Array
    contrast: Array
    scale: NDArray[np.int64]
    agreed: NDArray[np.int64]

    @classmethod
    def none(cls) -> "Tracks":
        """Return the table without rows."""
        return cls(
            ids=np.empty(0, np.int64),
            slots=np.empty(0, np.intp),
            left_px=np.empty((0, 2)),
            cov_left_px=np.empty((0, 2, 2)),
            points=np.empty((0, 4)),
            var_rho=np.empty(0),
            anchor_from_start=np.empty((0, 4, 4)),
            anchor_rays=np.empty((0, 2)),
            anchor_velocity_px_s=np.empty((0, 2)),
            slopes=np.empty((0, 2)),
            exposures=np.empty((0, 2)),
            contrast=np.empty(0),
            scale=np.empty(0, np.int64),
            agreed=np.empty(0, np.int64),
        )

    def __len__(self) -> int:
        return len(self.ids)

    def keep(self, rows: NDArray[Any]) -> "Tracks":
        """Return the given rows (mask or indices)."""
        if rows.dtype == bool and rows.all():
            return self
        return Tracks(*columns_at(_COLUMNS(self), rows))

    def drift_px(self, cam_from_previous: Array, slide_px: float, blurred_px: Array) -> Array:
        """Return σ (n,) px of the template drift since the last frame, eqs. (17) and (17c).

        The warp models pose and depth, but not the whole surface. A change of viewing direction or distance by |t|/Z
        changes the patch by as much, and part of this looks like motion of the point. `slide_px`: that part of the
        half width of templates, in their pixels; `blurred_px` (n,): σ by a change of sharpness.
        """
        return np.hypot(core.template_drift(self.points, cam_from_previous, self.scale, slide_px), blurred_px)

    def missing(self, wanted: int) -> int:
        """Return how many tracks with ordinary templates are missing."""
        return wanted - int(np.count_nonzero(self.scale == 1))

    def append(self, other: "Tracks") -> "Tracks":
        """Return these rows followed by the other's, whose ids must be larger."""
        return Tracks(*map(np.concatenate, zip(_COLUMNS(self), _COLUMNS(other), strict=True)))

    def weights(self, rules: MotionRules) -> Array:
        """Return the vote of each track (n,) between motions that sets of tracks favour, eq. (23b).

        The background has been rigid with the map for long, unlike moving objects.
        """
        return rules.first_vote * rules.full_history + np.minimum(self.agreed, rules.full_history)

    def judged(self, accepted: NDArray[np.bool_], ambiguous: bool) -> "Tracks":
        """Return the tracks after a frame; `accepted` (n,) agree with its motion. If it is ambiguous, nothing changes.

        Otherwise a body that is once taken for the background would soon outvote it.
        """
        return self if ambiguous else changed(self, agreed=np.where(accepted, self.agreed + 1, self.agreed // 2))

    def moved(self, cam_from_previous: Array) -> "Tracks":
        """Return the tracks with points transformed into a new camera; `left_px` remains as last measured."""
        points = self.points @ cam_from_previous.T
        depth = np.maximum(points[:, 2:3], MIN_DEPTH)
        return changed(self, points=points / depth, var_rho=self.var_rho / depth[:, 0] ** 2)

    def updated(
        self, p: StereoProjection, cam_from_previous: Array, z_px: Array, cov_px: Array, forgetting: float
    ) -> "Tracks":
        """Return the tracks moved by (4, 4) onto the rays of views (n, 4) with covariances (n, 4, 4).

        If the right side is seen, a scalar Kalman update gives 1/Z, after its variance is multiplied by `forgetting`.
        `left_px` does not change yet.
        """
        points, var_rho, cov_left_px = core.update_depths(p, self, cam_from_previous, z_px, cov_px, forgetting)
        return changed(self, cov_left_px=cov_left_px, points=points, var_rho=var_rho)

    def begun_with(self, projection: StereoProjection, twist: Array) -> "Tracks":
        """Return tracks that have all begun in the current camera, in which points move with a twist (6,)."""
        return changed(self, anchor_velocity_px_s=velocities(projection, self.points, twist)[:, :2])

    def shifted(self, projection: StereoProjection, px: Array) -> "Tracks":
        """Return the tracks after a further correction (n, 4) px of their views; `left_px` remains as last measured."""
        z_px = projection.project_homogeneous(self.points) - px
        return changed(self, points=core.seen_points(projection, z_px))

    def placed(self, rays: Array, left_px: Array, cov_left_px: Array, rho: Array, var_rho: Array) -> "Tracks":
        """Return the tracks with points on the rays (n, 2) of their views, with inverse depths (n,) and variances."""
        points = np.concatenate([rays, np.ones((len(rays), 1)), rho[:, None]], axis=1)
        return changed(self, left_px=left_px.copy(), cov_left_px=cov_left_px, points=points, var_rho=var_rho)

    def cov_points(self, projection: StereoProjection, drift_px: Array | None = None) -> Array:
        """Return covariances (n, 4, 4) of `points`: of ray and inverse depth, after a drift of σ (n,), eq. (33)."""
        drift_px = np.empty(0) if drift_px is None else drift_px
        return core.track_covariances(self.cov_left_px, self.var_rho, drift_px, projection.f_px, projection.baseline_m)


_COLUMNS = attrgetter(*Tracks.__match_args__)
