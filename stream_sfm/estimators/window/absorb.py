"""Frames leave the window: the prior then contains all information of earlier frames, eqs. (31)–(36).

What begins or ends with the newest camera, such as other errors of the rig, absorbs all frames of the window first.
"""

from collections.abc import Callable

import numpy as np

from ... import core
from ...geometry import Array, se3
from ...inertial.state import GRAVITY
from ...record import changed
from .inertia.inertial_window import InertialWindow
from .inertia.interval import JOINT, Known
from .inverse_depth import WhitenedViews
from .minimise import gauss_newton_step
from .prior import Prior
from .rig_state import RigState
from .state import WindowState


def absorbed_oldest(current: WindowState) -> WindowState:
    """Return the state with the oldest frame marginalised; it becomes the reference."""
    cam_from_ref, own, leaving, frame = current.cams_from_ref[0], current.own[:1], None, current.frames[0]
    if current.inertia is not None:
        of_gravity = current.prior.world_modes[JOINT.within("state", GRAVITY)]
        leaving, inertia = current.inertia.leaving(cam_from_ref, current.inertial_state, of_gravity @ of_gravity.T)
        current = changed(current, inertia=inertia)
    current, views = _without_oldest(current)
    prior, points, later = current.prior, current.points, current.views if current.frames else views
    seen_later = core.times_among(points.ids, later.ids, later.used) > 0
    in_reference = current.of_reference(points, own)
    prior = prior.absorb_frame(
        current.projection, in_reference, views, seen_later, current.amplitudes, cam_from_ref, leaving
    )
    prior = changed(prior, rig=prior.rig.with_part(not frame.is_ambiguous))
    kept = points.keep(seen_later if current.frames else core.among(points.ids, prior.ids))
    return changed(current.with_prior(prior), points=kept)


def absorbed_all(current: WindowState) -> WindowState:
    """Return the state with an empty window: the newest camera is the reference."""
    while current.frames:
        current = absorbed_oldest(current)
    return current


def _without_oldest(current: WindowState) -> tuple[WindowState, WhitenedViews]:
    """Return the state seen from the oldest frame of the window, which leaves it, and the views of that frame."""
    n = int(np.searchsorted(current.views.frame, 1))
    views, later = current.views[:n], current.views[n:]
    cam_from_ref, exposures, inertia = current.cams_from_ref[0], current.exposures, current.inertia
    return (
        changed(
            current,
            reference=current.frames[0],
            frames=current.frames[1:],
            views=changed(later, frame=later.frame - 1),
            first_views=None,  # they stay in the prior as they are
            inertia=None if inertia is None else inertia.without_oldest(),
            exposures=changed(exposures, seconds=exposures.seconds[1:]),
            ambiguous_motions=current.ambiguous_motions.seen_from(cam_from_ref),
            points=current.points.seen_from(cam_from_ref),
            cams_from_ref=se3.orthonormalise(current.cams_from_ref[1:] @ se3.inverse(cam_from_ref)),
            own=current.own[1:],
        ),
        views,
    )


def with_rig_change(current: WindowState, change: Callable[[RigState], tuple[RigState, Array, Array]]) -> WindowState:
    """Return the state with other errors of the rig after the newest frame, by the function `change`.

    Earlier views have the old errors, so all frames of the window are absorbed.
    """
    current = changed(absorbed_all(current), first_views=None)  # they have the old errors
    return current.with_prior(current.prior.with_rig_change(change(current.prior.rig)))


def with_inertia(current: WindowState, window: InertialWindow, known: Known) -> WindowState:
    """Add an inertial state, `known` in the newest camera, or replace it; that camera becomes the reference."""
    current = absorbed_all(current)
    return _begun_with(current, current.prior.without_state().with_state(known.state, known.cov), window)


def without_inertia(current: WindowState) -> WindowState:
    """Return the state without inertia, whose information about poses and points stays."""
    current = absorbed_all(current)
    return _begun_with(current, current.prior.without_state(), None)


def _begun_with(current: WindowState, prior: Prior, inertia: InertialWindow | None) -> WindowState:
    """Return the state with a prior and with inertia, solved in the reference camera with an empty window."""
    return gauss_newton_step(changed(current.with_prior(prior), inertia=inertia))[0]
