"""The oldest frame leaves the window: it becomes the reference camera, and its views become part of the prior."""

import numpy as np
from numpy.typing import NDArray

from ...geometry import se3
from ...geometry.se3 import Array
from ..ids import among, union
from .inverse_depth import Q_COLUMNS, NormalBlocks, in_reference, linearise, q_jacobian
from .map import Map
from .prior import Prior
from .window_frame import WindowFrame


def absorb_oldest_frame(current: Map) -> None:
    """Marginalise the oldest frame, eqs. (31)–(36): all that frames outside the window say is in the prior again."""
    frame = current.remove_oldest()
    current.move_reference(frame)
    # a point enters the prior with a stereo view: one side alone would leave its depth open
    frame.used &= frame.stereo | among(frame.ids, current.prior.ids)
    seen = frame.ids[frame.used]
    seen_later = union(*([f.ids[f.used] for f in current.frames] or [seen]))
    current.ref_from_anchor = se3.orthonormalise(frame.cam_from_ref @ current.ref_from_anchor)  # the new reference
    prior = current.prior.select(among(current.prior.ids, union(seen_later, seen)))
    at = np.searchsorted(current.ids, prior.ids)
    prior = prior.with_drift(_drift_since_previous(current, frame, prior.ids, at))
    blocks = _of_points(current, frame, at)
    prior = prior.absorb_frame(current.amplitudes, frame.cam_from_ref, current.q[at], blocks)
    new = np.searchsorted(current.ids, seen[~among(seen, prior.ids)])
    blocks = _of_points(current, frame, new)
    estimates = blocks.points_alone(current.q[new], prior.rig.mean - current.rig_error)
    prior = prior.with_points(current.ids[new], current.ref_from_anchor[new], *estimates)
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


def _of_points(current: Map, frame: WindowFrame, rows: NDArray[np.intp]) -> NormalBlocks:
    """Return the normal equations of the frame's views of the points `rows` (n,) of the map; it is the reference."""
    views = frame.views(current.ids).of_points(rows)
    here = np.eye(4)[None]
    anchors, q = current.ref_from_anchor[rows], current.q[rows]
    return linearise(current.projection, here, anchors, q, current.rig_error, views)


def _drift_since_previous(current: Map, frame: WindowFrame, ids: NDArray[np.int64], at: NDArray[np.intp]) -> Array:
    """Return covariances (n, 3, 3) of q of points `ids`, rows `at` of the map, for their drift up to `frame`.

    The frame is the reference already; the covariance is zero where it does not see a point.
    """
    cov = np.zeros((len(ids), 3, 3))
    known = among(ids, frame.ids)
    if not len(frame.var_drift) or not known.any():
        return cov
    ref_from_anchor = current.ref_from_anchor[at[known]]
    here = in_reference(ref_from_anchor, current.q[at[known]])
    anchor_from_here = np.linalg.inv(q_jacobian(here) @ ref_from_anchor[:, :, Q_COLUMNS])
    drift = frame.var_drift[np.searchsorted(frame.ids, ids[known])]
    cov[known] = (anchor_from_here * drift[:, None, :]) @ np.swapaxes(anchor_from_here, 1, 2)
    return cov
