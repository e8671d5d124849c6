"""Advances the front-end to a frame: updates the tracks and all that is learnt from frames."""

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from ..geometry.medians import median
from ..geometry.resection import Resection, SecondMotion
from ..geometry.view_stages import RawViews
from ..record import changed, record, rows_of
from .alignment import learn_noise
from .learnt.pair_check import Found
from .learnt.sharpness import lost_or_gained
from .mono.parallax import update_by_parallax
from .rules import ErrorRules, MotionRules
from .second_motions.motion_choice import may_be_scene
from .second_motions.start_check import StartCheck
from .second_motions.unsteadiness import Unsteadiness
from .seen import Seen
from .state import FrontEndState
from .step import Step
from .tracks import Tracks


@record
class Followed:
    """The result of following the tracks.

    The motion `cam_from_previous` (4, 4), and views `z_px` (n, 4) with covariances `cov_px` (n, 4, 4) of the surviving
    tracks, in the order of their table; `blurred_px` (n,): σ of their slides by a change of sharpness. `found`: all
    tracks that were found; `second`: an alternative motion that may be the right one; `settled`: as in `Observations`.
    """

    cam_from_previous: Array
    z_px: RawViews
    cov_px: Array
    blurred_px: Array
    found: Found | None = None
    second: SecondMotion | None = None
    settled: bool = False

    def keep(self, rows: NDArray[np.bool_]) -> "Followed":
        """Return the result for some of the tracks, selected by a mask (n,)."""
        views = RawViews(self.z_px[rows])
        return changed(self, z_px=views, cov_px=self.cov_px[rows], blurred_px=self.blurred_px[rows])


def learn(step: Step, state: FrontEndState, seen: Seen, motion: Resection, twist: Array) -> FrontEndState:
    """Learn the noise of views and the error of twists from a frame, and remember the twist (6,) of its points."""
    aligners = learn_noise(state.aligners, motion, seen.before.scale, seen.views.z_px)
    timing, error = state.timing, state.turning_error
    if step.by_inertia is None and timing.twist is not None and state.velocity.any():
        velocity = se3.log(motion.cam_from_ref) / step.dt_s
        error = error.after(timing.twist - 0.5 * (state.velocity + velocity))
    timing = changed(timing, twist=twist, std_turning=step.std_turning(error))
    return changed(state, aligners=aligners, timing=timing, turning_error=error)


def advance(
    step: Step, state: FrontEndState, seen: Seen, motion: Resection, alike: SecondMotion | None
) -> tuple[FrontEndState, Followed]:
    """Advance with the tracks that agree with a frame's motion, or with a second one unless that is of a body in front.

    `alike`: a motion for which the scene looks the same.
    """
    cam_from_start = se3.orthonormalise(motion.cam_from_ref @ state.cam_from_start)
    second = motion.second
    kept = motion.accepted if second is None or second.in_front else motion.accepted | second.views
    rows = kept.nonzero()[0]
    # if most views fit badly, the frame is poor (blurred, for instance) rather than full of outliers
    z_px, cov_px = rows_of(seen.views.z_px, rows), motion.spread * rows_of(seen.views.cov_px, rows)
    seen_px = seen.views.raw_px(rows)
    now = _placed(step, state, seen.before.keep(rows), motion.cam_from_ref, z_px, cov_px, cam_from_start)
    exposures, contrast = rows_of(seen.views.exposures, rows), seen.views.contrast[rows]
    now = changed(now, left_px=seen_px[:, :2].copy(), exposures=exposures, contrast=contrast)
    ambiguity, second, settled = state.ambiguity.after(motion, seen.before, alike)
    ambiguous = second is not None or ambiguity.lasts  # this motion, or which set of tracks is static
    state = changed(
        state,
        unsteadiness=_unsteadiness(step, state, motion.cam_from_ref),
        tracks=now.judged(motion.accepted[kept], ambiguous=ambiguous),
        cam_from_start=cam_from_start,
        velocity=se3.log(motion.cam_from_ref) / step.dt_s,
        ambiguity=ambiguity,
        start=_start(step, state, seen, motion, ambiguous),
    )
    found = Found(seen.before, seen.views.z_px, seen.views.cov_px, motion, step.agreed_samples is not None)
    blurred_px = _blurred_px(step, seen, motion)[rows]
    return state, Followed(motion.cam_from_ref, seen_px, cov_px, blurred_px, found, second, settled)


def _placed(
    step: Step,
    state: FrontEndState,
    tracks: Tracks,
    cam_from_previous: Array,
    z_px: Array,
    cov_px: Array,
    cam_from_start: Array,
) -> Tracks:
    """Return the tracks (n) in the new camera, on the rays of their views (n, 4) with covariances (n, 4, 4)."""
    projection, forgetting = step.setup.projection, step.setup.rules.of(MotionRules).forgetting
    if projection.virtual_right:
        return update_by_parallax(projection, tracks.moved(cam_from_previous), z_px, cov_px, cam_from_start, forgetting)
    return tracks.updated(projection, cam_from_previous, z_px, state.with_turn(z_px, cov_px), forgetting)


def _blurred_px(step: Step, seen: Seen, motion: Resection) -> Array:
    """Return σ (n,) px of the slides of the tracks because all patches have become sharper or more blurred."""
    by_motion = float(np.linalg.norm(motion.cam_from_ref[:3, 3]) * median(seen.views.points[:, 3]))
    changes = lost_or_gained(seen.before.contrast, seen.views.contrast, by_motion)
    share, config = step.setup.rules.of(ErrorRules).slide_blurred, step.setup.config
    return share * config.frontend.window_radius_px * seen.before.scale * changes


def _start(step: Step, state: FrontEndState, seen: Seen, motion: Resection, ambiguous: bool) -> StartCheck:
    """Return the check of the start after a frame; an `ambiguous` motion is reported already."""
    start = state.start
    if ambiguous or start.is_over:
        return start
    start = start.begun_with(float(motion.accepted.mean()))
    counts = motion.accepted
    if motion.second is None or not motion.second.in_front:
        counts = counts | may_be_scene(step.setup.rules, seen.before, motion.accepted, start.fills_view)
    return start.after(seen.before.ids[counts], motion.accepted[counts])


def _unsteadiness(step: Step, state: FrontEndState, cam_from_previous: Array) -> Unsteadiness | None:
    """Return how unsteady motions are after this one; None while that is unknown."""
    before = state.unsteadiness
    if not state.velocity.any():
        return before
    if before is None:
        rules = step.setup.rules.of(MotionRules)
        assumed = (step.setup.std_acceleration[[0, 3]] * step.dt_s**2) ** 2
        before = Unsteadiness(assumed, rules.assumed_frames, rules)
    expected = se3.exp(state.velocity * step.dt_s)
    return before.after(se3.log(se3.inverse(expected) @ cam_from_previous))
