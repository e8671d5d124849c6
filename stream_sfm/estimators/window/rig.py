"""The errors of the rig in the window: judged by the joint minimum of each frame, held there, and learnt from."""

import numpy as np

from ... import core
from ...geometry import Array
from ...record import changed
from ...rig_model.estimate import RigEstimate
from ...rig_model.model import RigModel
from .state import WindowState


def judged_rig(current: WindowState) -> tuple[WindowState, RigEstimate | None]:
    """Return the rig's errors as estimated by the latest system, and the state that holds them there.

    They are None for an exact rig.
    """
    rig, system = current.prior.rig, current.system
    if not len(rig):
        return current, None
    views = system.solved
    mean, cov, information = views.mean_of_rig, views.cov_of_rig, views.information_of_rig
    agreement = rig.parts.agreement
    counted = rig.tempered(mean, cov, information) if rig.steady else (mean, cov)
    rig, found = rig.contradicted(mean, cov).judged(*counted, agreement)
    change = rig.held - current.rig_error
    current = current.moved(core.window_with_rig_moved(current.state, current.amplitudes, system.solved, change))
    age = rig.age_s(current.newest_frame.stamp_ns)
    by_parts = (None, None) if agreement is None else (agreement.evidence, agreement.thirds)
    estimate = RigEstimate(found.mean, found.cov, found.p_wrong, mean, cov, rig.size, None, age, *by_parts)
    current = changed(
        current,
        prior=changed(current.prior, rig=rig),
        solved=system.with_cov_rig(found.cov),
    )
    return current, estimate


def learnt_rig(
    current: WindowState, estimate: RigEstimate, field_std_px: float, by_rows: tuple[Array, Array]
) -> WindowState:
    """Update the prior of the rig's errors: their sizes by the estimate, and the information from image rows.

    `by_rows`: information (m,) and weighted sums (m,).
    """
    rig = current.prior.rig.learnt(estimate.mean_if_wrong, estimate.cov_if_wrong, field_std_px, *by_rows)
    return changed(current, prior=changed(current.prior, rig=rig))


def with_field(current: WindowState, model: RigModel) -> WindowState:
    """Add a field to the rig's errors, and its effect on the views of the window."""
    views, first, prior = current.views, current.first_views, current.prior
    prior = prior.with_field(len(model) - len(prior.rig))
    more = prior.modes.shape[2] - len(current.amplitudes)
    return changed(
        current,
        frames=tuple(changed(frame, rig=model) for frame in current.frames),
        views=changed(views, field=model.field_at(views.expected_px)),
        first_views=None if first is None else changed(first, field=model.field_at(first.z_px)),
        prior=prior,
        amplitudes=np.pad(current.amplitudes, (0, more)),
    )
