"""The oldest frame leaves the window: it becomes the reference camera, and its views become part of the prior."""

import numpy as np

from ... import core
from ...record import changed, rows_of
from .inverse_depth import NormalBlocks, State
from .map import Map
from .prior import Prior
from .window_frame import WindowFrame


def absorb_oldest_frame(current: Map) -> None:
    """Marginalise the oldest frame, eqs. (31)–(36): all that frames outside the window say is in the prior again."""
    cam_from_ref = current.cams_from_ref[0]
    frame, views = current.remove_oldest()
    prior, later = current.prior, current.views if current.frames else views
    seen_later = core.times_among(current.ids, later.ids, later.used) > 0
    known = np.searchsorted(current.ids, prior.ids)
    in_reference = State(np.eye(4)[None], *current.state()[1:])
    pinholes, seen = current.projection.pinholes, (views.of_core, views.stereo, views.var_drift)
    rows, stays, cov, anchors, q, blocks, new_ids, alone = core.leaving_views(
        pinholes, in_reference, *seen, seen_later, known, prior.cov
    )
    if len(rows) < len(known):
        prior = changed(prior, ids=prior.ids[rows], mean=prior.mean[rows], modes=rows_of(prior.modes, rows))
    seen_first = new_ids, *alone
    posterior = changed(prior, cov=cov).absorb_frame(
        current.amplitudes, cam_from_ref, anchors, q, NormalBlocks(*blocks), stays, seen_first
    )
    current.prior = _refocused(posterior.truncate_modes(), current, frame)
    current.amplitudes = np.zeros(current.prior.modes.shape[2])
    current.select(seen_later if current.frames else core.among(current.ids, current.prior.ids))


def _refocused(prior: Prior, current: Map, frame: WindowFrame) -> Prior:
    """Return the prior with a focus that may have moved faster or slower since `frame`, if it moves at all."""
    if frame.rig is None or not current.frames:
        return prior
    passed_s = (current.frames[0].stamp_ns - frame.stamp_ns) / 1e9
    age_s = prior.rig.age_s(frame.stamp_ns)
    root = frame.rig.root_of_focusing(prior.rig.held, prior.rig.cov_held, age_s, passed_s)
    return prior.with_rig_change(root) if root.any() else prior
