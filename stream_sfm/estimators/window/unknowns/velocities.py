"""Shifts of a map's views by the velocities of its frames, with delay and readout of the cameras, eqs. (70) to (70b).

The velocity of the newest frame is an extrapolation. If a delay of the right camera is probable, the error of this
velocity, which shifts all right views coherently, is an unknown of the frame, eq. (36b): six amplitudes of σ = 1. Once
later frames show the velocity, it remains only in the right image rows, as the front-end has compensated the delay in
these with a velocity of its own.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .... import core
from ....geometry import Array
from ....geometry.linear import scaled_cholesky
from ....geometry.stereo import StereoProjection, clamp_depth
from ....record import changed
from ....rig_model.estimate import CERTAIN
from ....rig_model.model import LEAST_VARIANCE, RigModel
from ....rig_model.terms import DISPARITY
from ..inverse_depth import WhitenedViews, at_rest, expected, held, points_alone, timed
from ..state import WindowState
from ..window_frame import WindowFrame
from .columns import with_effects, with_unknown, without_unknown

_TWIST = 6  # amplitudes


def expect(
    current: WindowState,
    frame: WindowFrame,
    views: WhitenedViews,
    rows: NDArray[np.intp],
    points: Array,
    cam_from_previous: Array,
    std_acceleration: Array,
) -> tuple[WindowState, WhitenedViews, Array | None]:
    """Set the effects of the rig's errors on `rows` of the views of the next frame, with the motion of their points.

    `points` (n, 4): homogeneous, in the previous camera; the rough motion (4, 4) since. Returns the state, the views,
    and (n, 4, j) px of σ = 1: the errors that these views share, from the `own` amplitudes of the frame, from the
    uncertainty of the timing, with accelerations of σ (6,), and from that of the disparity. The latter is None for an
    exact rig.
    """
    if frame.rig is None:
        return current, views, None
    poses = [np.eye(4), *current.cams_from_ref, cam_from_previous @ current.newest_cam_from_ref]
    stamps_ns = [f.stamp_ns for f in (*current.all_frames, frame)]
    seconds, clock = current.exposures.clock.seconds(np.array(poses), stamps_ns, std_acceleration)
    current = changed(current, exposures=changed(current.exposures, seconds=seconds, clock=clock))
    frames = *current.all_frames, frame
    motions = _as_turning(core.point_motions(np.array(poses), seconds), frames)
    *_, before, now = motions
    moved = clamp_depth(points @ cam_from_previous.T)
    by_timing = np.zeros_like(views.timing)
    timing = frame.rig.timing(current.prior.rig.held_at(frame.stamp_ns))
    by_timing[rows] = frame.rig.by_timing(moved, now, timing[0], views.expected_px[rows])
    views = changed(views, timing=by_timing)
    of_twist = std_acceleration * (seconds[-1] - seconds[-2])
    size_s = np.copysign(np.sqrt(timing[0] ** 2 + np.diag(timing[1])), timing[0])
    by_readout_px = by_timing[rows, :, 1] * (size_s[1] / frame.rig.units_of_timing[1])
    by_twist = _matters(current, timing, by_readout_px)
    if not by_twist.any():
        current = _without_twist(current)
    if current.exposures.has_twist or by_twist.any():
        current = _with_twist(current, by_twist)
        cov_twist = current.exposures.twist_error.cov(std_acceleration, seconds)
        cov_twist = cov_twist + np.diag((current.prior.rig.rules.least_twist * of_twist) ** 2)
        late_s = frame.rig.late_s(views.expected_px, np.where(by_twist, size_s, 0.0))
        own = _twist_columns(current.projection, views, rows, moved, late_s, cov_twist)
        views = changed(views, own=np.concatenate([views.own, own], axis=2))
    of_timing = core.timing_unknowns(*frame.rig.cameras, points, before[0], moved, now[0], *timing, of_twist)
    cov_held = current.prior.rig.cov_held[DISPARITY, DISPARITY] + LEAST_VARIANCE * np.eye(DISPARITY.stop)
    by_disparity = frame.rig.by_disparity(points, cam_from_previous, views.z_px[rows])
    of_disparity = by_disparity @ np.linalg.cholesky(cov_held)
    return current, views, np.concatenate([views.own[rows], of_timing, of_disparity], axis=2)


def _matters(current: WindowState, timing: tuple[Array, Array], by_readout_px: Array) -> NDArray[np.bool_]:
    """Return whether the error of the newest twist is an unknown (2,), through delay and through readout.

    A delay that was probable once stays. The readout counts while its possible effect on the views (n, 4) is large:
    while a camera turns fast and its readout is not known.
    """
    rules, (mean_s, cov_s) = current.prior.rig.rules, timing
    is_late = abs(mean_s[0]) > rules.probable_delay * np.sqrt(cov_s[0, 0])
    seen_px = by_readout_px[np.isfinite(by_readout_px)]
    is_read_out = bool(len(seen_px)) and (seen_px**2).mean() > rules.readout_moves_px**2
    return np.array([is_late or current.exposures.by_twist[0], is_read_out])


def _with_twist(current: WindowState, by_twist: NDArray[np.bool_]) -> WindowState:
    """Add the error of the twist to the unknowns of each frame; that of earlier frames counts as known.

    `by_twist` (2,): whether it matters in the newest frame through delay and through readout.
    """
    if not current.exposures.has_twist:
        current = with_unknown(current, current.own.shape[1], _TWIST)
    current = changed(current, exposures=changed(current.exposures, has_twist=True, by_twist=by_twist))
    left = current.views.own[current.newest, :, -_TWIST:].copy()
    left[:, :3] = 0.0
    return with_effects(current, current.newest, slice(-_TWIST, None), left)


def _without_twist(current: WindowState) -> WindowState:
    """Remove the errors of twists from the unknowns of all frames, if no view of the window shows one."""
    exposures = current.exposures
    if not exposures.has_twist or current.first_views is not None or current.views.own[..., -_TWIST:].any():
        return current
    exposures = changed(exposures, has_twist=False, by_twist=np.zeros(2, bool))
    return without_unknown(changed(current, exposures=exposures), slice(-_TWIST, None))


def _twist_columns(
    projection: StereoProjection,
    views: WhitenedViews,
    rows: NDArray[np.intp],
    moved: Array,
    late_s: Array,
    cov_twist: Array,
) -> Array:
    """Return the effect (V, 4, 6) px of an error of the twist, of covariance (6, 6), on views.

    `moved` (n, 4): the points of `rows`; the others are where their views show them. `late_s` (V, 4) is the exposure of
    each side after the stamp. The effect on a missing side is zero.
    """
    points = core.seen_points(projection, views.z_px)
    points[rows] = moved
    points[~np.isfinite(points).all(axis=1)] = 0, 0, 1, 0  # far ahead: the left side alone has no delay
    by_twist = np.stack([core.velocities(projection, points, e[None]) for e in np.eye(_TWIST)], axis=2)
    moved = late_s[:, :, None] * by_twist
    moved[~np.isfinite(views.expected_px)] = 0.0
    return np.asarray(moved @ scaled_cholesky(cov_twist))


def renewed_timing(current: WindowState) -> WindowState:
    """Update the effects of delay and readout on the used views of the window with the current velocities.

    Later frames show the camera's velocity better. The effects are still evaluated where a view was expected before it
    counted: at a place correlated with the view's own noise, weakly visible errors would be biased by a fixed amount
    that does not average out.
    """
    rig = current.newest_frame.rig
    if rig is None:
        return current
    poses = np.array([np.eye(4), *current.cams_from_ref])
    motions = _as_turning(core.point_motions(poses, current.exposures.seconds), current.all_frames)
    current = changed(current, exposures=changed(current.exposures, motions=motions))
    if current.first_views is not None:
        current = _with_first_renewed(current, current.first_views, rig)
    views = timed(current.state, current.views, rig, motions[1:], _timing(current, rig)[0])
    return changed(current, views=views)


def is_timed(current: WindowState) -> bool:
    """Whether delay or readout are certainly not zero, so that poses depend on velocities."""
    rig = current.newest_frame.rig
    if rig is None:
        return False
    mean, cov = _timing(current, rig)
    return bool((mean**2 > CERTAIN**2 * np.diag(cov)).any())


def cov_of_timing(current: WindowState, std_acceleration: Array) -> tuple[WindowState, Array]:
    """Return the covariance (6, 6) of the newest pose from errors of its velocity, by way of delay and readout.

    The state has learnt how large these errors are.
    """
    rig, newest = current.newest_frame.rig, current.views[current.newest]
    if rig is None or not newest.used.any():
        return current, np.zeros((6, 6))
    exposures = current.exposures
    error = exposures.twist_error.after([f.index for f in current.all_frames], exposures.motions[:, 0])
    mean, cov = _timing(current, rig)
    elsewhere = ~exposures.by_twist  # the effect of the others is in the joint covariance
    mean, cov = mean * elsewhere, cov * np.outer(elsewhere, elsewhere)
    in_cam = core.points_of_views(current.state, newest)
    std_s, cov_twist = np.sqrt(mean**2 + np.diag(cov)), error.cov(std_acceleration, exposures.seconds)
    current = changed(current, exposures=changed(exposures, twist_error=error))
    return current, core.cov_of_timed_pose(*rig.cameras, in_cam, std_s, cov_twist)


def _with_first_renewed(current: WindowState, views: WhitenedViews, rig: RigModel) -> WindowState:
    """Build the prior again from the first frame's views, whose motion later frames show better.

    This is possible as long as nothing else is in the prior.
    """
    known, rig_error, prior = current.points, current.rig_error, current.prior
    state = current.of_reference(known.keep(np.searchsorted(known.ids, prior.ids)))
    views = changed(views, used=core.among(views.ids, state.ids))
    views = at_rest(expected(state, views, rig), rig, prior.rig.age_s(current.reference.stamp_ns))
    views = timed(state, views, rig, current.exposures.motions[:1], _timing(current, rig)[0])
    ages_s = np.array([prior.rig.age_s(f.stamp_ns) for f in current.frames])
    later = held(current.views, views.ids, views.expected_px, current.rules.rests_px)
    estimates = points_alone(current.projection, views, state, prior.rig.mean - rig_error)
    return changed(
        current,
        first_views=views,
        views=at_rest(later, rig, ages_s[current.views.frame]),
        prior=prior.with_first_views(*estimates),
    )


def _timing(current: WindowState, rig: RigModel) -> tuple[Array, Array]:
    """Return the held delay and readout (2,) of the newest frame, seconds, and their covariance (2, 2)."""
    return rig.timing(current.prior.rig.held_at(current.newest_frame.stamp_ns))


def _as_turning(motions: Array, frames: Sequence[WindowFrame]) -> Array:
    """Return motions (n, 2, 6) of points in frames (n), with the angular velocity of the gyroscope if there is one.

    A polynomial through poses cannot follow a shaken camera.
    """
    for motion, frame in zip(motions, frames, strict=True):
        if frame.turning is not None:
            motion[:, 3:] = frame.turning
    return motions
