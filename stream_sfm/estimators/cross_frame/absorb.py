"""The oldest frame leaves the window: it becomes the reference camera, and its views become part of the prior."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...geometry import se3
from ...geometry.se3 import Array
from ..ids import among, union
from .inverse_depth import Q_COLUMNS, WhitenedViews, in_reference, q_jacobian
from .map import Map
from .prior import Prior
from .window_frame import WindowFrame


def absorb_oldest_frame(current: Map) -> None:
    """Marginalise the oldest frame, eqs. (31)–(36): all that frames outside the window say is in the prior again."""
    frame, views = current.remove_oldest()
    current.move_reference(frame)
    # a point enters the prior with a stereo view: one side alone would leave its depth open
    views = replace(views, used=views.used & (views.stereo | among(views.ids, current.prior.ids)))
    seen = views.ids[views.used]
    seen_later = union(current.views.ids[current.views.used]) if current.frames else seen
    current.ref_from_anchor = se3.orthonormalise(frame.cam_from_ref @ current.ref_from_anchor)  # the new reference
    prior = current.prior.select(among(current.prior.ids, union(seen_later, seen)))
    at = np.searchsorted(current.ids, prior.ids)
    prior = prior.with_drift(_drift_since_previous(current, views, prior.ids, at))
    points = prior.ids, current.ref_from_anchor[at], current.q[at]
    blocks = current.linearised_in_reference(views, *points, current.rig_error)
    prior = prior.absorb_frame(current.amplitudes, frame.cam_from_ref, current.q[at], blocks)
    new = np.searchsorted(current.ids, seen[~among(seen, prior.ids)])
    ids, anchors, q = current.ids[new], current.ref_from_anchor[new], current.q[new]
    blocks = current.linearised_in_reference(views, ids, anchors, q, current.rig_error)
    estimates = blocks.points_alone(q, prior.rig.mean - current.rig_error)
    prior = prior.with_points(ids, anchors, *estimates)
    prior = prior.select(among(prior.ids, seen_later))
    current.prior = _refocused(prior.truncate_modes(), current, frame)
    current.amplitudes = np.zeros(current.prior.modes.shape[2])

    if current.frames:
        cams = se3.orthonormalise(current.cams_from_ref() @ se3.inverse(frame.cam_from_ref))
        for f, cam in zip(current.frames, cams, strict=True):
            f.cam_from_ref = cam
    current.select(among(current.ids, union(seen_later, current.prior.ids)))


def _refocused(prior: Prior, current: Map, frame: WindowFrame) -> Prior:
    """Return the prior with a focus that may have moved faster or slower since `frame`, if it moves at all."""
    if frame.rig is None or not current.frames:
        return prior
    passed_s = (current.frames[0].stamp_ns - frame.stamp_ns) / 1e9
    age_s = prior.rig.age_s(frame.stamp_ns)
    root = frame.rig.root_of_focusing(prior.rig.held, prior.rig.cov_held, age_s, passed_s)
    return prior.with_rig_change(root) if root.any() else prior


def _drift_since_previous(
    current: Map, views: WhitenedViews, ids: NDArray[np.int64], at: NDArray[np.intp]
) -> Array:
    """Return covariances (n, 3, 3) of q of points `ids`, rows `at` of the map, for their drift up to their `views`.

    These are of the reference already; the covariance is zero where it does not see a point.
    """
    cov = np.zeros((len(ids), 3, 3))
    known = among(ids, views.ids)
    if not known.any():
        return cov
    ref_from_anchor = current.ref_from_anchor[at[known]]
    here = in_reference(ref_from_anchor, current.q[at[known]])
    anchor_from_here = np.linalg.inv(q_jacobian(here) @ ref_from_anchor[:, :, Q_COLUMNS])
    drift = views.var_drift[np.searchsorted(views.ids, ids[known])]
    cov[known] = (anchor_from_here * drift[:, None, :]) @ np.swapaxes(anchor_from_here, 1, 2)
    return cov
