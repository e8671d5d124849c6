"""One frame of the window, and the views that it brings."""

from dataclasses import field

import numpy as np

from ... import core
from ...geometry import Array
from ...geometry.stereo import StereoProjection
from ...record import record
from ...rig_model.model import RigModel
from ...rig_model.terms import by_turn
from ...types import Observations
from .inertia.interval import Interval
from .inverse_depth import WhitenedViews


@record
class WindowFrame:
    """Per-frame data other than pose and views.

    `std_turn_rad`: σ about each axis of the apparent rotation since the previous frame by patches that slide alike.
    `ambiguity` (6, k): a root of the further covariance of the motion from the previous frame, in axes of this camera;
    consecutive frames share the first six columns, and the others belong to one frame. `interval`: the inertial
    samples since the previous frame; they predict the `velocity` (3,), and the gyroscope gives `turning` (2, 3), the
    angular velocity and acceleration of points. Without samples `interval` and `turning` are None. `misfit`: the images
    do not fit each other or the calibration. `twist_size`: how much more than usual its twist errs, eq. (7b).
    """

    index: int
    stamp_ns: int
    rig: RigModel | None
    std_turn_rad: float = 0.0
    ambiguity: Array = field(default_factory=lambda: np.zeros((6, 0)))
    interval: Interval | None = None
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    turning: Array | None = None
    misfit: bool = False
    twist_size: float = 1.0

    @property
    def is_ambiguous(self) -> bool:
        """Whether the motion from the previous frame may not be the camera's."""
        return self.misfit or self.ambiguity.shape[1] > 0


def views_of(observations: Observations, projection: StereoProjection, age_s: float = 0.0) -> WhitenedViews:
    """Return all views of a frame as those of row 0, all used.

    `age_s`: the time for which errors of the rig have grown.
    """
    weight, n = _weights(observations), len(observations.track_ids)
    own, terms, timing, field = np.zeros((n, 4, 0)), np.zeros((n, 4, 0)), np.zeros((n, 4, 0)), np.zeros((n, 0))
    if observations.rig is not None:
        timing = observations.rig.model.without_timing(n)
        own = by_turn(projection, observations.z_px, observations.rig.turn_root)
        terms, field = observations.rig.model.at_rest(observations.z_px, age_s)
    return WhitenedViews(
        frame=np.zeros(n, np.intp),
        ids=observations.track_ids,
        z_px=np.where(np.isfinite(observations.z_px), observations.z_px, 0.0),
        root=core.whitening_of_views(observations.z_px, observations.cov_px) * weight[:, None, :],
        weight=weight,
        used=np.ones(n, bool),
        stereo=np.asarray(np.isfinite(observations.z_px).all(axis=1)),
        expected_px=observations.z_px,
        var_drift=_drift_variances(observations, projection),
        own=own,
        terms=terms,
        timing=timing,
        field=field,
    )


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
        return np.zeros((len(observations.track_ids), 3))
    scale = np.array([1, 1, 1 / projection.baseline_m]) / projection.f_px
    return np.asarray((std_px[:, None] * scale) ** 2)
