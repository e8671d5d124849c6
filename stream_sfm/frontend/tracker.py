"""Tracking: finds the points of the previous frame in this one, and the motion that they agree on.

Depths come from the right image, or from the parallax of one camera (`mono/parallax.py`).
"""

import numpy as np

from ..geometry import Array
from ..geometry.resection import Resection, resect
from ..pictures.prepared import PreparedImages
from ..record import changed
from ..types import ExpectedMotion
from .advance import Followed, advance, learn
from .aligned_views import AlignedViews, align
from .learnt.first_timing import first_timed
from .rough_motion import find_rough_motion
from .rules import MotionRules
from .second_motions.motion_choice import choose, is_scene_hidden
from .second_motions.overlays import overlays
from .second_motions.repetition import smaller_of_alike
from .seen import Seen
from .state import FrontEndState, Setup
from .step import Step


def follow(
    setup: Setup,
    state: FrontEndState,
    images: PreparedImages,
    stamp_ns: int,
    by_inertia: ExpectedMotion | None = None,
) -> tuple[FrontEndState, Followed | None]:
    """Follow all tracks from the previous frame into this one; None if no motion is found.

    `by_inertia`: the motion that inertial samples predict, from which flow and templates then start. Without a motion,
    the state changes only by what the frame shows about the cameras and about a hidden background.
    """
    step = Step.of(setup, state, images, stamp_ns, by_inertia)
    rough = None if step is None else find_rough_motion(step, state.aligners, state.tracks)
    if step is None or rough is None:
        return state, None
    if (laid_over := overlays(setup, state.tracks, rough.left_px)).any():
        state = changed(state, tracks=state.tracks.keep(~laid_over))
        rough = find_rough_motion(step, state.aligners, state.tracks)
        if rough is None:
            return state, None
    state, rough = smaller_of_alike(step, state, rough)
    twist = step.twist(state.velocity, rough.cam_from_previous)
    first = step.first_twist(twist, rough.cam_from_previous), step.std_turning(state.turning_error)
    state = first_timed(setup.projection, state, *first)
    views = align(setup, state, images, rough, twist)
    seen, since_start = Seen.of(step, state, rough, twist, views), state.start
    state, motion = _agreed_motion(step, state, seen, rough.cam_from_previous)
    start = rough.cam_from_previous if motion is None else motion.cam_from_ref
    state, turned = _turned(state, seen, start)
    if turned is not None and state.turn_watch is not None:
        seen = Seen.of(step, state, rough, twist, turned, state.turn_watch.larger)
        state = changed(state, start=since_start)  # a frame is one event
        state, motion = _agreed_motion(step, state, seen, rough.cam_from_previous)
    if motion is None:
        return state, None
    state = learn(step, state, seen, motion, twist)
    return advance(step, state, seen, motion, rough.alike)


def _turned(state: FrontEndState, seen: Seen, cam_from_previous: Array) -> tuple[FrontEndState, AlignedViews | None]:
    """Return the state after a frame near a motion (4, 4), and its views if its turn was not expected.

    They are those that agree with it. Single views are gated once more then.
    """
    if state.turn_watch is None or seen.apparent_turns is None:
        return state, None
    points, cov_points = seen.point_views.points, seen.point_views.cov_points
    views = points, cov_points, seen.views.any_row_px, seen.views.cov_px
    watch, agree = state.turn_watch.judge(*views, cam_from_previous, seen.apparent_turns)
    state = changed(state, turn_watch=watch)
    if agree is None:
        return state, None
    off_row = np.count_nonzero(agree & np.isnan(seen.views.z_px[:, 2]))
    expected = not len(watch.larger) and off_row < seen.point_views.settings.second_views
    return state, None if expected else seen.views.with_off_row(agree)


def _agreed_motion(
    step: Step, state: FrontEndState, seen: Seen, start: Array
) -> tuple[FrontEndState, Resection | None]:
    """Return the motion that the views agree on, sought from `start` (4, 4), and the state after that.

    It is None if too few agree, or if a body hides the background. Its gate decides which tracks survive.
    """
    rules = step.setup.rules.of(MotionRules)
    predicted = step.predicted if rules.one_body else None
    motion = resect(seen.point_views, start, seen.weights, predicted, amplitudes=seen.amplitudes)
    if not rules.poor_frames:
        motion = changed(motion, spread=1.0)
    motion, checked = choose(step, state, seen, motion)
    of_body = 0.0 if motion.second is None or not motion.second.in_front else seen.weights[motion.second.views].sum()
    many = seen.weights[motion.accepted].sum() >= rules.min_agreement * (seen.weight - of_body)
    agree = motion.ok and (many or step.is_sampled(motion))
    hidden = is_scene_hidden(step, state, seen, motion)
    state = changed(state, start=checked, background_hidden=hidden or (state.background_hidden and not agree))
    return state, motion if agree and not hidden else None
