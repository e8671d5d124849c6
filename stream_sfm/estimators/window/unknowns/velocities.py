"""Shifts of a map's views by the velocities of its frames, with delay and readout of the cameras, eqs. (70) to (70c).

The velocity of the newest frame is an extrapolation. The errors of velocities are unknowns of the frames (`twist.py`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .... import core
from ....config import MotionConfig
from ....geometry import Array
from ....geometry.linear import LEAST_VARIANCE
from ....geometry.medians import median
from ....geometry.stereo import clamp_depth
from ....record import changed
from ....rig_model.estimate import CERTAIN
from ....rig_model.model import RigModel
from ....rig_model.terms import DISPARITY
from ..inverse_depth import WhitenedViews, at_rest, expected, held, points_alone, timed
from ..state import WindowState
from ..window_frame import WindowFrame
from .twist import expect_twist, with_twists


def expect(
    current: WindowState,
    frame: WindowFrame,
    views: WhitenedViews,
    rows: NDArray[np.intp],
    points: Array,
    cam_from_previous: Array,
    rules: MotionConfig,
) -> tuple[WindowState, WhitenedViews, Array | None]:
    """Set the effects of the rig's errors on `rows` of the views of the next frame, with the motion of their points.

    `points` (n, 4): homogeneous, in the previous camera; the rough motion (4, 4) since. Returns the state, the views,
    and (n, 4, j) px of σ = 1: the errors that these views share, from the `own` amplitudes of the frame, from the
    uncertainty of the timing, and from that of the disparity. The latter is None for an exact rig.
    """
    if frame.rig is None:
        return current, views, None
    poses = [np.eye(4), *current.cams_from_ref, cam_from_previous @ current.newest_cam_from_ref]
    stamps_ns = [f.stamp_ns for f in (*current.all_frames, frame)]
    std_acceleration = np.array(rules.std_acceleration)
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
    std_change = std_acceleration * min(median(np.diff(seconds)), rules.speeds_up_s)
    current, views = expect_twist(current, frame.rig, views, rows, moved, timing, std_change)
    # the error of the twist is among the frame's own
    of_timing = core.timing_unknowns(*frame.rig.cameras, points, before[0], moved, now[0], *timing, None)
    cov_held = current.prior.rig.cov_held[DISPARITY, DISPARITY] + LEAST_VARIANCE * np.eye(DISPARITY.stop)
    by_disparity = frame.rig.by_disparity(points, cam_from_previous, views.z_px[rows])
    of_disparity = by_disparity @ np.linalg.cholesky(cov_held)
    return current, views, np.concatenate([views.own[rows], of_timing, of_disparity], axis=2)


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
    current = with_twists(changed(current, exposures=changed(current.exposures, motions=motions)), rig)
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
