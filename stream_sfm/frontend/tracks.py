"""The table of live tracks: one row per point, ascending ids."""

from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config.rules import MotionRules
from ..geometry import Array
from ..geometry.stereo import MIN_DEPTH, StereoProjection, velocities
from ..record import changed, columns_at, record


@record
class Tracks:
    """Rows (n) of one array each.

    `ids`; `slots` of the templates; `left_px` (n, 2): the last measured left position, with `cov_left_px` (n, 2, 2).
    `points` (n, 4): homogeneous (X/Z, Y/Z, 1, 1/Z) in the current rectified camera, and `var_rho` of the inverse depth.
    Of the frame where the template was cut, the anchor: `anchor_from_start` (n, 4, 4), its pose in the front-end's own
    chain of motions; `anchor_rays` (n, 2): (X/Z, Y/Z) of the template's middle, exact by definition;
    `anchor_velocity_px_s` (n, 2): how that moved in the left image; `slopes` (n, 2): ∂(1/Z)/∂(X/Z, Y/Z) of the surface,
    1/m; `scale` (n,): image pixels per pixel of the template, 1 or `WIDE`; `exposures` (n, 2): gain and offset of grey
    values in the last left image over those of the template.
    `agreed` (n,): in how many frames the track agreed with the motion, halved each time it did not.
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
    scale: NDArray[np.int64]
    agreed: NDArray[np.int64]

    @classmethod
    def none(cls) -> "Tracks":
        """No rows."""
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
            scale=np.empty(0, np.int64),
            agreed=np.empty(0, np.int64),
        )

    def __len__(self) -> int:
        return len(self.ids)

    def keep(self, rows: NDArray[Any]) -> "Tracks":
        """The given rows (mask or indices)."""
        if rows.dtype == bool and rows.all():
            return self
        return Tracks(*columns_at(_COLUMNS(self), rows))

    def drift_px(self, cam_from_previous: Array, slide_px: float) -> Array:
        """Standard deviation (n,) px of how far templates slid since the last frame, eq. (17).

        The warp knows pose and depth, not all of the surface: a change of viewing direction or distance by |t|/Z
        changes the patch by as much, and a part of that passes for motion of the point. `slide_px`: that part of
        the half width of templates, in their pixels.
        """
        return core.template_drift(self.points, cam_from_previous, self.scale, slide_px)

    def missing(self, wanted: int) -> int:
        """How many tracks of ordinary templates more there should be."""
        return wanted - int(np.count_nonzero(self.scale == 1))

    def append(self, other: "Tracks") -> "Tracks":
        """These rows, then the other's; the other's ids must be larger."""
        return Tracks(*map(np.concatenate, zip(_COLUMNS(self), _COLUMNS(other), strict=True)))

    def weights(self, rules: MotionRules) -> Array:
        """Return the vote of each track (n,) where sets of tracks favour different motions, eq. (23b).

        The background has long been rigid with the map; what moves by itself has not.
        """
        return rules.first_vote * rules.full_history + np.minimum(self.agreed, rules.full_history)

    def judged(self, accepted: NDArray[np.bool_], ambiguous: bool) -> "Tracks":
        """After a frame whose motion `accepted` (n,) agree with; where another may be right, all keep their history.

        Otherwise a body that is once taken for the background would outvote it soon.
        """
        return self if ambiguous else changed(self, agreed=np.where(accepted, self.agreed + 1, self.agreed // 2))

    def moved(self, cam_from_previous: Array) -> "Tracks":
        """Points carried into a new camera; `left_px` stays what was last measured."""
        points = self.points @ cam_from_previous.T
        depth = np.maximum(points[:, 2:3], MIN_DEPTH)
        return changed(self, points=points / depth, var_rho=self.var_rho / depth[:, 0] ** 2)

    def updated(
        self, p: StereoProjection, cam_from_previous: Array, z_px: Array, cov_px: Array, forgetting: float
    ) -> "Tracks":
        """Tracks moved by (4, 4) onto the rays of views (n, 4) with covariances (n, 4, 4); not yet their `left_px`.

        1/Z by a scalar Kalman update where the right side is seen, after its variance has grown by `forgetting`.
        """
        points, var_rho, cov_left_px = core.update_depths(p, self, cam_from_previous, z_px, cov_px, forgetting)
        return changed(self, cov_left_px=cov_left_px, points=points, var_rho=var_rho)

    def begun_with(self, projection: StereoProjection, twist: Array) -> "Tracks":
        """Tracks that have all begun in the current camera, in which points move with a twist (6,) per second."""
        return changed(self, anchor_velocity_px_s=velocities(projection, self.points, twist)[:, :2])

    def shifted(self, projection: StereoProjection, px: Array) -> "Tracks":
        """Points after their views are corrected by a further (n, 4) px; `left_px` stays what was last measured."""
        z_px = projection.project_homogeneous(self.points) - px
        return changed(self, points=core.seen_points(projection, z_px))

    def placed(self, rays: Array, left_px: Array, cov_left_px: Array, rho: Array, var_rho: Array) -> "Tracks":
        """Points put on the rays (n, 2) at which they were seen, with inverse depths (n,) and their variances."""
        points = np.concatenate([rays, np.ones((len(rays), 1)), rho[:, None]], axis=1)
        return changed(self, left_px=left_px.copy(), cov_left_px=cov_left_px, points=points, var_rho=var_rho)

    def cov_points(self, projection: StereoProjection, drift_px: Array | None = None) -> Array:
        """Covariances (n, 4, 4) of `points`: of the ray and of the inverse depth, after a drift of σ (n,), eq. (33)."""
        drift_px = np.empty(0) if drift_px is None else drift_px
        return core.track_covariances(
            self.cov_left_px, self.var_rho, drift_px, projection.f_px, projection.baseline_m
        )


_COLUMNS = attrgetter(*Tracks.__match_args__)
