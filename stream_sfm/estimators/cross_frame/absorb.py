"""The oldest frame leaves the window: it becomes the reference camera, and its views become part of the prior."""

import numpy as np

from ... import core
from ...record import changed
from ..ids import among, union
from .map import Map
from .prior import Prior
from .window_frame import WindowFrame


def absorb_oldest_frame(current: Map) -> None:
    """Marginalise the oldest frame, eqs. (31)–(36): all that frames outside the window say is in the prior again."""
    cam_from_ref = current.cams_from_ref[0]
    frame, views = current.remove_oldest()
    # a point enters the prior with a stereo view: one side alone would leave its depth open
    views = changed(views, used=views.used & (views.stereo | among(views.ids, current.prior.ids)))
    seen = views.ids[views.used]
    seen_later = union(current.views.ids[current.views.used]) if current.frames else seen
    prior = current.prior.select(among(current.prior.ids, union(seen_later, seen)))
    at = np.searchsorted(current.ids, prior.ids)
    anchors, q = current.ref_from_anchor[at], current.q[at]
    drift = core.drift_covariances(prior.ids, anchors, q, views.ids, views.var_drift)
    prior = changed(prior, cov=prior.cov + drift)
    blocks = current.linearised_in_reference(views, prior.ids, anchors, q, current.rig_error)
    prior = prior.absorb_frame(current.amplitudes, cam_from_ref, anchors, q, blocks)
    new = seen[~among(seen, prior.ids) & among(seen, seen_later)]
    prior = prior.select(among(prior.ids, seen_later))
    at = np.searchsorted(current.ids, new)
    anchors, q = current.ref_from_anchor[at], current.q[at]
    blocks = current.linearised_in_reference(views, new, anchors, q, current.rig_error)
    estimates = blocks.points_alone(q, prior.rig.mean - current.rig_error)
    prior = prior.with_points(new, *estimates)
    current.prior = _refocused(prior.truncate_modes(), current, frame)
    current.amplitudes = np.zeros(current.prior.modes.shape[2])
    current.select(among(current.ids, union(seen_later, current.prior.ids)))


def _refocused(prior: Prior, current: Map, frame: WindowFrame) -> Prior:
    """Return the prior with a focus that may have moved faster or slower since `frame`, if it moves at all."""
    if frame.rig is None or not current.frames:
        return prior
    passed_s = (current.frames[0].stamp_ns - frame.stamp_ns) / 1e9
    age_s = prior.rig.age_s(frame.stamp_ns)
    root = frame.rig.root_of_focusing(prior.rig.held, prior.rig.cov_held, age_s, passed_s)
    return prior.with_rig_change(root) if root.any() else prior
