"""Tracking: where the points of the previous frame are in this one, and the motion that they agree on.

Track by flow, find the robust motion, predict how patches look, align them with their templates, resect all views
jointly and gate them, learn the noise, advance. Depths come from the right image, or from the parallax of one
camera (`mono/parallax.py`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import se3
from ..geometry.point_views import PointViews
from ..geometry.resection import MANY_VIEWS, Resection, SecondMotion, resect
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..record import record, rows_of
from ..rig_model.terms import by_turn
from ..types import ExpectedMotion
from .alignment import WIDE, AlignedViews, learn_noise
from .ambiguity import AmbiguityMemory
from .depth_order import decided, depth_order, of_background
from .inertia import Unsteadiness, steadier, without_newcomer
from .inertial_choice import is_camera, nearer
from .mono.parallax import update_by_parallax
from .pair_check import Found
from .prepared import PreparedImages
from .repetition import rival_motion, still_repeats
from .rough_motion import RoughMotion, find_rough_motion
from .start_check import StartCheck
from .state import FrontEndState, Setup
from .step_check import StepCheck
from .tracks import Tracks

# Fraction of the tracks that should be in view and agree with the final motion; fewer agree by chance: after a
# sudden blur of 5 px 14 of 196 did, with a motion that was off by 7 cm.
_MIN_AGREEMENT = 0.15
# A track survives up to this multiple of the expected template drift, eq. (17). With 1, 41 frames of KITTI 06 are
# degraded.
_SLIDES_MOST = 2.0
# The background is hidden where fewer tracks agree that have ever agreed before than MANY_VIEWS and than half, while
# as many new tracks agree on a motion that has jumped, or that came while it was hidden already: what agrees then moves
# by itself.
_JUMP = 4.0  # standard deviations of what the assumed acceleration does to a motion between two frames
# How long a motion is searched for from the last frame that had one. Views that return do so within a second; after
# that too much has changed for flow.
_MAX_GAP_S = 1.0


@record
class Followed:
    """What following the tracks gave: the motion `cam_from_previous` (4, 4), and views `z_px` (n, 4) with covariances
    `cov_px` (n, 4, 4) of the tracks that live on, in the order of their table; `found`: all that were found; `other`:
    another motion that may be right as well; `settled`: as in `Observations`."""

    cam_from_previous: Array
    z_px: Array
    cov_px: Array
    found: Found | None = None
    other: SecondMotion | None = None
    settled: bool = False


@record
class _Known:
    """Of the tracks (n) that were found in a frame, how they were `before`, with covariances `cov_points` (n, 4, 4) of
    their points; their `weights` (n,), and `weight`: of all tracks that should have been found. `known_px` (n, 4):
    what the error of the disparity, as it is known, does to their views. `unknown_px` (n, 4, j): errors that all views
    share, of delay, readout, rows and disparity, and last of a turn of the right camera, and `cov_turn` (3, 3) of turns
    that they feign; None of an exact rig."""

    before: Tracks
    cov_points: Array
    weights: Array
    weight: float
    known_px: Array | float = 0.0
    unknown_px: Array | None = None
    cov_turn: Array | None = None


def follow(
    setup: Setup,
    state: FrontEndState,
    images: PreparedImages,
    stamp_ns: int,
    by_inertia: ExpectedMotion | None = None,
) -> tuple[FrontEndState, Followed | None]:
    """Follow all tracks from the frame before into this one; None where no motion is found.

    `by_inertia`: the motion that inertial samples predict, from which flow and templates start then. Without a motion
    the state is the same but for what the frame says about the cameras and about a hidden background.
    """
    dt_s = (stamp_ns - state.previous_ns) / 1e9
    if state.previous is None or not len(state.tracks):
        return state, None
    predicted, known_motion = se3.exp(state.velocity * dt_s), bool(state.velocity.any())
    if by_inertia is not None:
        predicted, known_motion = se3.inverse(by_inertia.previous_from_cam), True
    rough = find_rough_motion(setup, state.aligners, state.previous, images, state.tracks, predicted, known_motion)
    if rough is None:
        return state, None
    if not state.start.is_over:
        rough = of_background(setup, state, state.previous, images, rough, predicted)
    rough, rival = _likelier_of_alike(setup, state, state.previous, images, rough)
    twist = _twist_now(state.velocity, rough.cam_from_previous, dt_s)
    if by_inertia is not None:  # a shaken camera turns by now as no two frames tell
        twist = np.concatenate([twist[:3], by_inertia.twist[3:]])
    if state.rows_waiting is not None:
        state = replace(state, rows=state.rows.after(state.rows_waiting, twist), rows_waiting=None)
    if state.timing.twist is None:  # the first frame did not know how its points moved
        state = _first_timed(setup.projection, state, twist)
    views, expected = align(setup, state, images, state.tracks, rough, twist)
    known = _known(setup, state, expected, views, rough.cam_from_previous, twist, dt_s)
    motions = rough.cam_from_previous, predicted, by_inertia
    state, motion = _resect(setup, state, known, views, *motions, dt_s)
    start = rough.cam_from_previous if motion is None else motion.cam_from_ref
    state, turned = _judge_turn(state, known, views, start)
    if turned is not None:  # the left sides alone
        views = replace(views, z_px=np.where([True, True, False, False], views.z_px, np.nan))
        state, motion = _resect(setup, state, known, views, *motions, dt_s)
    if motion is None:
        return state, None
    aligners = learn_noise(state.aligners, motion, known.before.scale, views.z_px)
    state = replace(state, aligners=aligners, timing=replace(state.timing, twist=twist))
    # a pair whose right sides agree with a turn of the right camera is whole
    found_px = views.z_px if turned is None else np.where(turned[:, None], views.any_row_px, views.z_px)
    if is_camera(by_inertia, motion):
        state = replace(state, start=state.start.settled())
    return _advance(setup, state, views, Found(known.before, found_px, views.cov_px, motion), rival, dt_s)


def _likelier_of_alike(
    setup: Setup, state: FrontEndState, previous: PreparedImages, images: PreparedImages, rough: RoughMotion
) -> tuple[RoughMotion, SecondMotion | None]:
    """The motion and another one that looks the same, if there is one: while hardly any track has a history, and for
    as long as the scene repeats itself then. Of the two the smaller one comes first."""
    seen, found = (previous, images, state.tracks, rough), rough.cam_from_previous
    if state.ambiguity.repeats:
        other = state.ambiguity.other_than(found)
        return rough, other if still_repeats(setup, *seen, other) else None
    rival = None if np.count_nonzero(state.tracks.agreed) >= MANY_VIEWS else rival_motion(setup, *seen)
    if rival is None:
        return rough, None
    size = [np.linalg.norm(se3.log(m) / setup.std_acceleration) for m in (found, rival.cam_from_ref)]
    if size[0] > size[1]:
        near = rival.cam_from_ref
        smaller = find_rough_motion(setup, state.aligners, previous, images, state.tracks, near, motion_known=True)
        if smaller is not None:
            return smaller, replace(rival, cam_from_ref=found)
    return rough, rival


def learn_timing(projection: StereoProjection, state: FrontEndState, mean: Array, cov: Array) -> FrontEndState:
    """Take in that delay and readout are N(`mean` (2,), `cov` (2, 2)), seconds, and place the tracks anew by it."""
    before, now = state.timing, state.timing.with_estimate(mean, cov)
    state = replace(state, timing=now)
    if now.twist is None or (before.mean == now.mean).all():
        return state
    points = state.tracks.points
    change_px = replace(now, mean=now.mean - before.mean).taken_out(points, now.twist)
    return replace(state, tracks=state.tracks.shifted(projection, change_px))


def _first_timed(projection: StereoProjection, state: FrontEndState, twist: Array) -> FrontEndState:
    """Place the tracks of the first frame by a timing that is known, now that it is known how they moved there."""
    tracks, timing = state.tracks.begun_with(projection, twist), replace(state.timing, twist=twist)
    if timing.mean.any():
        tracks = tracks.shifted(projection, timing.taken_out(tracks.points, twist))
    return replace(state, tracks=tracks, timing=timing)


def lose(state: FrontEndState) -> FrontEndState:
    """Forget all tracks and the velocity."""
    return replace(
        state,
        tracks=Tracks.none(),
        velocity=np.zeros(6),
        timing=replace(state.timing, twist=None),
        ambiguity=AmbiguityMemory(),
        start=StartCheck(),
        steps=StepCheck(),  # how a new map moves is not known
        background_hidden=False,
        turn_watch=None if state.turn_watch is None else state.turn_watch.calm(),
    )


def may_wait(state: FrontEndState, stamp_ns: int) -> bool:
    """Whether the tracks of the last frame that was followed may still be found later than at that stamp."""
    return len(state.tracks) > 0 and stamp_ns - state.previous_ns < _MAX_GAP_S * 1e9


def _twist_now(velocity: Array, cam_from_previous: Array, dt_s: float) -> Array:
    """How the points move at the end of the interval from the previous frame, per second."""
    if dt_s <= 0:
        return np.zeros(6)
    between = se3.log(cam_from_previous) / dt_s
    return between + 0.5 * (between - velocity) if velocity.any() else between


def align(
    setup: Setup, state: FrontEndState, images: PreparedImages, tracks: Tracks, rough: RoughMotion, twist: Array
) -> tuple[AlignedViews, NDArray[np.bool_]]:
    """Find the tracks (n) in the new images, near where a rough motion puts them: the views of those found.

    Also returns which of them (n,) should be in view. `twist` (6,): how the points move in the camera, per second.
    """
    wide, in_both = state.aligners.get(WIDE), not setup.projection.virtual_right
    has_wide = wide is not None and (tracks.scale == WIDE).any()
    expected, rows, points, z_px, cov_px, any_row_px, taken_px = core.align_tracks(
        state.right_sides(twist),
        state.timing,
        tracks,
        tracks.slots,
        rough.cam_from_previous,
        rough.cam_from_previous @ state.cam_from_start,
        rough.left_px,  # what flow lost, the motion may find
        rough.agree,
        state.aligners[1].in_images(images, in_both),
        wide.in_images(images, in_both) if wide is not None and has_wide else None,
    )
    if setup.right_area is not None:
        left_only = np.array([False, False, True, True])
        z_px, any_row_px = (
            np.where(left_only & setup.unseen_in_right(px)[:, None], np.nan, px) for px in (z_px, any_row_px)
        )
    return AlignedViews(rows, points, z_px, cov_px, any_row_px, taken_px), expected


def _known(
    setup: Setup,
    state: FrontEndState,
    expected: NDArray[np.bool_],
    views: AlignedViews,
    motion: Array,
    twist: Array,
    dt_s: float,
) -> _Known:
    """What is known of the tracks that were found, for a motion (4, 4) near the true one; see the record."""
    before, weights = state.tracks.keep(views.rows), state.tracks.weights
    drift_px = _SLIDES_MOST * core.template_drift(
        views.points, motion, before.scale, setup.config.frontend.window_radius_px
    )
    cov_points = before.cov_points(setup.projection, drift_px)
    known = before, cov_points, weights[views.rows], float(weights[expected].sum())
    if state.turn_watch is None or state.disparity is None:
        return _Known(*known)
    seen, std_twist = (before.points, views.points, views.z_px), setup.std_acceleration * dt_s
    unknown_px, cov_turn = core.unknown_errors(state.timing, state.rows_with_delay, *seen, twist, std_twist)
    known_px, of_disparity = state.disparity.effects(before.points, motion, views.z_px)
    of_turn = by_turn(setup.projection, views.z_px, state.turn_root)
    return _Known(*known, known_px, np.concatenate([unknown_px, of_disparity, of_turn], axis=2), cov_turn)


def _resect(
    setup: Setup,
    state: FrontEndState,
    known: _Known,
    views: AlignedViews,
    start: Array,
    predicted: Array,
    by_inertia: ExpectedMotion | None,
    dt_s: float,
) -> tuple[FrontEndState, Resection | None]:
    """The motion that the views found agree on; its gate says which tracks live on. None where too few agree.

    It is sought from `start` (4, 4); `predicted` (4, 4): by the last velocity, or `by_inertia`.
    """
    before, weights, gate_probability = known.before, known.weights, setup.config.robust.gate_probability
    seen = before.points, known.cov_points, views.z_px - known.known_px, views.cov_px
    point_views = PointViews(setup.projection, *seen, gate_probability, known.unknown_px)
    motion = resect(point_views, start, weights, predicted)
    if motion.ok and not state.start.is_over:
        motion = decided(before, point_views, weights, motion)
    assumed = setup.std_acceleration * dt_s**2
    std_change = assumed if state.unsteadiness is None else np.minimum(assumed, state.unsteadiness.std)
    if motion.ok and _jumps(motion.cam_from_ref, predicted, std_change):
        motion = steadier(before, point_views, weights, motion, predicted)
    in_question = not state.start.is_over or state.ambiguity.frames_left > 0
    if motion.ambiguous is not None and not in_question:
        jump, other_jumps = (
            _jumps(m, predicted, assumed) for m in (motion.cam_from_ref, motion.ambiguous.cam_from_ref)
        )
        motion = without_newcomer(before, motion) if other_jumps and not jump else motion
    if by_inertia is not None:
        motion = nearer(by_inertia, point_views, weights, motion)
    agree = motion.ok and weights[motion.accepted].sum() >= _MIN_AGREEMENT * known.weight
    hidden = _is_background_hidden(setup, state, before, motion, predicted, dt_s)
    state = replace(state, background_hidden=hidden or (state.background_hidden and not agree))
    return state, motion if agree and not hidden else None


def _judge_turn(
    state: FrontEndState, known: _Known, views: AlignedViews, cam_from_previous: Array
) -> tuple[FrontEndState, NDArray[np.bool_] | None]:
    """Which of the views (n,) agree with a turn of the right camera, where the frame shows an unusual one."""
    if state.turn_watch is None or known.cov_turn is None:
        return state, None
    seen = known.before.points, known.cov_points, views.any_row_px, views.cov_px
    watch, agree = state.turn_watch.judge(*seen, cam_from_previous, known.cov_turn)
    return replace(state, turn_watch=watch), agree


def _jumps(cam_from_previous: Array, predicted: Array, std_change: Array) -> bool:
    """Whether a motion (4, 4) is beyond what the last velocity and changes of σ (6,) allow."""
    return bool((np.abs(se3.log(se3.inverse(predicted) @ cam_from_previous)) > _JUMP * std_change).any())


def _is_background_hidden(
    setup: Setup, state: FrontEndState, found: Tracks, motion: Resection, predicted: Array, dt_s: float
) -> bool:
    """Whether the tracks found (n,) are mostly of things that move by themselves, and so is their motion."""
    trusted, agree = found.agreed > 0, motion.accepted
    needed = min(MANY_VIEWS, 0.5 * np.count_nonzero(state.tracks.agreed))
    if np.count_nonzero(agree & trusted) >= needed:
        return False
    jumps = _jumps(motion.cam_from_ref, predicted, setup.std_acceleration * dt_s**2)
    return (state.background_hidden or jumps) and int(np.count_nonzero(agree & ~trusted)) >= MANY_VIEWS


def _advance(
    setup: Setup,
    state: FrontEndState,
    views: AlignedViews,
    found: Found,
    rival: SecondMotion | None,
    dt_s: float,
) -> tuple[FrontEndState, Followed]:
    """Move on to this frame, each track found put where it was seen: those that agree with it, or a second motion.

    Views are handed out as they were seen. `rival`: a motion that looks the same.
    """
    projection, before, motion = setup.projection, found.before, found.motion
    cam_from_start = se3.orthonormalise(motion.cam_from_ref @ state.cam_from_start)
    kept = motion.accepted if motion.second is None else motion.accepted | motion.second.views
    rows = kept.nonzero()[0]
    # where most views fit badly the frame itself is poor, blurred for instance, and not full of outliers
    z_px, cov_px = rows_of(views.z_px, rows), motion.spread * rows_of(views.cov_px, rows)
    seen_px, now = z_px + rows_of(views.taken_px, rows), before.keep(rows)
    if projection.virtual_right:
        now = update_by_parallax(projection, now.moved(motion.cam_from_ref), z_px, cov_px, cam_from_start)
    else:
        now = now.updated(projection, motion.cam_from_ref, z_px, state.with_turn(z_px, cov_px))
    now = replace(now, left_px=seen_px[:, :2].copy())
    start = state.start
    ambiguity, other, settled = state.ambiguity.after(motion, before.agreed, rival)
    if other is None and not start.is_over:  # of another motion it is said already that it may be that of a body
        # what lies before the points that agree may move by itself, and says nothing about them
        counts = motion.accepted | (depth_order(before, before.keep(motion.accepted)) >= 0)
        start = start.after(before.ids[counts], motion.accepted[counts])
    unsteadiness = state.unsteadiness
    if dt_s > 0 and state.velocity.any():
        if unsteadiness is None:
            unsteadiness = Unsteadiness((setup.std_acceleration[[0, 3]] * dt_s**2) ** 2)
        expected = se3.exp(state.velocity * dt_s)
        unsteadiness = unsteadiness.after(se3.log(se3.inverse(expected) @ motion.cam_from_ref))
    state = replace(
        state,
        unsteadiness=unsteadiness,
        tracks=now.judged(motion.accepted[kept], ambiguous=other is not None),
        cam_from_start=cam_from_start,
        velocity=se3.log(motion.cam_from_ref) / dt_s if dt_s > 0 else np.zeros(6),
        ambiguity=ambiguity,
        start=start,
    )
    return state, Followed(motion.cam_from_ref, seen_px, cov_px, found, other, settled)
