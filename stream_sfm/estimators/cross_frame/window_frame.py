"""One frame of the window: its views, which of them count, and its pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from ...rig_model.model import RigEffects, RigModel
from ...types import Observations
from .inverse_depth import WhitenedViews


@dataclass(slots=True)
class WindowFrame:
    """Views `z_px` (n, 4) of `ids` with their whitening `root` (n, 4, 4), of which `used` (n,) bool count.

    The root is that of a view as one of its track: errors that last are counted once. `weight` (n, 4): the square root
    of what that leaves of the view's own information, coordinate by coordinate; 1 where errors are independent.
    `rig_effects`: of the rig's errors. `ambiguity` (6, k): by what else the motion from the frame
    before may be wrong, in axes of this camera; frames in a row share the first six columns, the others are of each
    alone.
    `stereo` (n,) bool: both sides were seen. `var_drift` (n, 3): drift of q since the frame before, or (0, 3) for none.
    `expected_px` (n, 4): where the used views were expected before they counted; there the rig's errors are taken.
    """

    index: int
    ids: NDArray[np.int64]
    z_px: Array
    root: Array
    weight: Array
    rig_effects: RigEffects
    rig: RigModel | None
    stamp_ns: int
    stereo: NDArray[np.bool_]
    used: NDArray[np.bool_]
    var_drift: Array
    cam_from_ref: Array
    ambiguity: Array
    expected_px: Array

    @classmethod
    def from_observations(
        cls, observations: Observations, projection: StereoProjection, age_s: float = 0.0
    ) -> "WindowFrame":
        """Return the frame with all its views in use and its pose still to be found.

        `age_s`: for how long errors of the rig have grown.
        """
        weight = _weights(observations)
        return cls(
            index=observations.frame_index,
            ids=observations.track_ids,
            z_px=np.nan_to_num(observations.z_px),
            root=core.whitening_of_views(observations.z_px, observations.cov_px) * weight[:, None, :],
            weight=weight,
            rig_effects=_effects_at_rest(observations, age_s),
            rig=None if observations.rig is None else observations.rig.model,
            stamp_ns=observations.stamp_ns,
            stereo=np.asarray(np.isfinite(observations.z_px).all(axis=1)),
            used=np.ones(len(observations.track_ids), bool),
            var_drift=_drift_variances(observations, projection),
            cam_from_ref=np.eye(4),
            ambiguity=np.zeros((6, 0)),
            expected_px=observations.z_px.copy(),
        )

    def corrected_px(self, rig_error: Array) -> Array:
        """Return the views (n, 4) without errors (m,) of the rig."""
        return self.z_px - self.rig_effects.at(rig_error)

    def seen_px(self, rows: NDArray[np.intp]) -> Array:
        """Return the views (k, 4) of `rows` (k,), NaN for a side that was not seen."""
        z_px = self.z_px[rows].copy()
        z_px[~self.stereo[rows], 2:] = np.nan
        return z_px

    def all_views(self, row: int) -> WhitenedViews:
        """Return all views as those of frame `row`, with ids for points."""
        frame = np.full(len(self.ids), row)
        return WhitenedViews(frame, self.ids, self.z_px, self.root, self.weight, self.rig_effects)

    def views(self, ids: NDArray[np.int64]) -> WhitenedViews:
        """Return the used views, all of points in `ids` (ascending), as views of frame 0."""
        return self.all_views(0)[np.flatnonzero(self.used)].of_map(ids)


def _effects_at_rest(observations: Observations, age_s: float) -> RigEffects:
    """Return what errors of the rig do to the views, at rest; none where none are possible."""
    if observations.rig is None:
        return RigEffects.none(len(observations.track_ids))
    return observations.rig.model.effects_by_parts(observations.z_px, age_s=age_s)


def _weights(observations: Observations) -> Array:
    """Return the square roots (n, 4) of the share of each coordinate's information that counts."""
    inflation = observations.lasting.inflation
    if inflation is None:
        return np.ones((len(observations.track_ids), 4))
    return np.repeat(1 / np.sqrt(inflation), 2, axis=1)


def _drift_variances(observations: Observations, projection: StereoProjection) -> Array:
    """Return the drift of patches over their surfaces as variances of q (n, 3), eq. (33): rays, and disparity."""
    std_px = observations.lasting.std_drift_px
    if std_px is None:
        return np.empty((0, 3))
    scale = np.array([1, 1, 1 / projection.baseline_m]) / projection.f_px
    return np.asarray((std_px[:, None] * scale) ** 2)
