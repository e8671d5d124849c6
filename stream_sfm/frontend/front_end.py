"""The front-end of a stereo pair: it turns rectified images into observations.

In each frame it follows the points (`tracker.py`), begins new ones where they are missing (`new_points.py`) and checks
the images (`pictures/`). A frame is skipped if nothing can be followed and nothing new be found, or if the
background is hidden. The next frames are then followed from the last good frame, for at most a second.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ..camera.rectification import Rectifier
from ..camera.rig import StereoRig
from ..config import Config
from ..geometry import Array
from ..geometry.resection import SecondMotion
from ..geometry.robust_rules import RobustRules
from ..geometry.view_stages import RawViews
from ..pictures.checks import Suspicions
from ..pictures.content import are_alike, image_note
from ..pictures.prepared import PreparedImages
from ..pictures.rules import ImageRules
from ..pictures.torn import copied, torn
from ..record import changed
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import RigModel
from ..types import Ambiguity, ExpectedMotion, LastingErrors, Observations, RigChange, RigView
from .advance import Followed
from .alignment import WIDE, TemplateAligner, valid_area
from .learnt.disparity_error import DisparityError
from .learnt.first_timing import learn_timing
from .learnt.pair_check import PairCheck, PairFit, PairRules, problem_of, resolution_problem
from .learnt.right_turn import TurnWatch, rig_change, with_turn
from .learnt.rows import Rows
from .learnt.template_errors import TemplateErrors, turn_of_slides
from .learnt.timing import Timing
from .learnt.usual_turns import TurnRules
from .new_points import PointRules, begin_points, renews
from .rules import ErrorRules, MotionRules
from .second_motions.ambiguity import AmbiguityMemory
from .second_motions.overlays import are_laid_over
from .second_motions.start_check import StartCheck
from .state import FrontEndState, Setup
from .tracker import follow

_JUMPED = "the whole view has changed at once: were images held back, or is this another place?"
_LAID_OVER = "nearly all points are at the same pixels of left and right: is a picture laid over the images?"
_HIDDEN = "background occluded: the remaining tracks are on moving objects"


class StereoFrontEnd:
    """Follows points through rectified pairs.

    The object itself never changes. All that is learnt from frames is in the `FrontEndState`, which each step replaces;
    `start` is the state before the first frame. So a state can be kept, copied and continued from more than once.

    Observations are corrected for the calibration errors that the rig's refinement knows.
    """

    def __init__(self, rig: StereoRig, rectifier: Rectifier, config: Config) -> None:
        projection, in_right = rectifier.projection, rectifier.valid_in_right
        radius_px, rules = config.frontend.window_radius_px, config.rules
        right_area = None if in_right is None else valid_area(in_right, radius_px)
        self.setup = Setup(projection, config, right_area, rectifier.raw_shifts_px)
        self.problem = resolution_problem(rig, rules.of(PairRules))  # of the calibration, in every frame
        self.rig = RigModel.of(
            projection, config.rig, rig.refinement, rectifier.rows_of, rig.timing, rectifier.by_focal
        )
        self.start = FrontEndState(
            aligners={scale: TemplateAligner.empty(config, rectifier.valid, scale) for scale in (1, WIDE)},
            timing=Timing.unknown(projection, config.rig, rectifier.rows_of, rig.timing),
            rows=Rows.unknown(projection, config),
            turn_watch=None if config.rig.exact else TurnWatch.begun(projection, rules.of(TurnRules)),
            disparity=DisparityError.of(self.rig),
            errors=TemplateErrors.begun_by(rules.of(ErrorRules)),
            ambiguity=AmbiguityMemory.none(rules.of(MotionRules)),
            start=StartCheck.of(rules.of(MotionRules)),
            pair=PairCheck.of(rules.of(PairRules)),
            pictures=Suspicions.begun(rules),
        )

    def prepare(self, images: PreparedImages, frame_index: int) -> None:
        """Compute in advance what `step` needs: the corners, if a frame of this index needs them.

        Any thread may call it at any time and in any order, also for frames that are never stepped.
        """
        if renews(frame_index, self.setup.rules.of(PointRules).period):
            _ = images.corner_strength  # computed now, kept for `step`

    def step(
        self,
        state: FrontEndState,
        images: PreparedImages,
        stamp_ns: int,
        expected: ExpectedMotion | None = None,
    ) -> tuple[FrontEndState, Observations]:
        """Return the state after the next frame, and the frame's observations. Stamps must ascend.

        `expected`: the motion up to this frame from inertial samples, if there are any.
        """
        rows = copied(images, state.previous, self.setup.rules.of(ImageRules).slope_grey)
        tear, state = torn(rows, state.copied), changed(state, copied=rows)
        if tear:
            return self._skipped(changed(state, frame_index=state.frame_index + 1, stamp_ns=stamp_ns), stamp_ns, tear)
        if expected is not None and expected.since_ns != state.previous_ns:
            expected = None  # it starts at a frame other than the one that is followed from
        state, change = self._take_out_turn(state)
        before, (state, followed) = state, follow(self.setup, state, images, stamp_ns, expected)
        unconfirmed = bool(before.start.problem) and state.start.is_over and state.start.contradicted
        state, restarts = self._check(before, state, images, followed)
        if followed is None or restarts:
            state, observed = self._start_over(state, images, stamp_ns, wait=not restarts)
        else:
            state, observed = self._go_on(state, images, stamp_ns, followed)
            observed = replace(observed, unconfirmed=True) if unconfirmed else observed
        if change is not None and observed.rig is not None:
            root = self.rig.root_of_turn(self.setup.rules.of(TurnRules).std_rad)
            observed = replace(observed, rig=replace(observed.rig, change=change, change_root=root))
        return changed(state, frame_index=state.frame_index + 1, stamp_ns=stamp_ns), observed

    def _take_out_turn(self, state: FrontEndState) -> tuple[FrontEndState, RigChange | None]:
        """Correct all further measurements for a turn of the right camera that earlier frames have shown."""
        watch = state.turn_watch
        rad = None if watch is None else watch.lasting_rad
        if watch is None or rad is None:
            return state, None
        first = state.frame_index - len(watch.unusual)
        calm, turn_rad = watch.calm(), state.turn_rad + rad
        disparity = DisparityError.of(self.rig)  # its error is as unknown as in the beginning
        now = state.frame_index
        state = changed(state, turn_rad=turn_rad, turned_at=now, turn_watch=calm, disparity=disparity)
        return state, rig_change(self.setup.projection, first, rad)

    def _check(
        self,
        before: FrontEndState,
        state: FrontEndState,
        images: PreparedImages,
        followed: Followed | None,
    ) -> tuple[FrontEndState, bool]:
        """Check whether left and right are consistent.

        Also returns whether the map starts over because of this. `before`: the state before the frame was followed.
        """
        projection, config, fit = self.setup.projection, self.setup.config, None
        if followed is not None and followed.found is not None:
            fit = PairFit.of(followed.found, projection, config, before.pair.missing)
        factor = state.aligners[1].noise.factor
        problem = self.problem or state.pictures.problem_of_pair
        problem = problem or problem_of(images, state.previous, fit, state.rows, factor, config.rules.of(PairRules))
        pair, restarts = state.pair.after(problem, fit, state.next_id)
        return changed(state, pair=pair), restarts

    def _go_on(
        self, state: FrontEndState, images: PreparedImages, stamp_ns: int, followed: Followed
    ) -> tuple[FrontEndState, Observations]:
        """Return the observations of a frame that was followed, with the points that begin in it."""
        drift_px = state.tracks.drift_px(followed.cam_from_previous, self.setup.slide_px, followed.blurred_px)
        state, z_new, cov_new = begin_points(self.setup, state, images)
        z_px = RawViews(np.concatenate([followed.z_px, z_new]))
        cov_px = np.concatenate([followed.cov_px, cov_new])
        note, state = self._note(state, images, z_px), _seen(state, images, stamp_ns, z_px)
        f_px, drifts_px = self.setup.projection.f_px, np.concatenate([drift_px, np.zeros(len(z_new))])
        return self._observed(
            state,
            stamp_ns,
            z_px,
            cov_px,
            note or state.pictures.problem,
            std_slides=(drifts_px, turn_of_slides(drift_px, f_px, self.setup.rules.of(ErrorRules).alike)),
            cam_from_previous=followed.cam_from_previous,
            n_new=len(z_new),
            ambiguity=_ambiguity(followed.second, state),
            settled=followed.settled,
        )

    def _start_over(
        self, state: FrontEndState, images: PreparedImages, stamp_ns: int, wait: bool
    ) -> tuple[FrontEndState, Observations]:
        """Return the observations of a frame that could not be followed: new points, or none if the frame is skipped.

        Without `wait`, the tracks are dropped at once.
        """
        rules = self.setup.rules
        waits = wait and state.may_wait(stamp_ns, rules.of(MotionRules).max_gap_s)
        if waits and state.background_hidden:
            return self._skipped(state, stamp_ns, _HIDDEN)
        fresh, z_px, cov_px = begin_points(self.setup, state.lost(), images)
        note = self._note(fresh, images, z_px)
        if waits and len(z_px) < self.setup.rules.of(RobustRules).min_inliers:
            return self._skipped(state, stamp_ns, note)
        jumped = wait and state.previous is not None and are_alike(images, state.previous, rules.of(ImageRules))
        if jumped:
            note = note or _JUMPED
        seen = _seen(fresh, images, stamp_ns, z_px)
        return self._observed(seen, stamp_ns, z_px, cov_px, note, n_new=len(z_px), jumped=jumped)

    def _skipped(self, state: FrontEndState, stamp_ns: int, note: str) -> tuple[FrontEndState, Observations]:
        """Return the observations of a frame without views: the next one is followed from the last good one."""
        return self._observed(state, stamp_ns, RawViews(np.empty((0, 4))), np.empty((0, 4, 4)), note)

    def _observed(
        self,
        state: FrontEndState,
        stamp_ns: int,
        z_px: RawViews,
        cov_px: Array,
        note: str,
        std_slides: tuple[Array, float] | None = None,
        **others: Any,
    ) -> tuple[FrontEndState, Observations]:
        """Return the observations of all tracks, views (n, 4) with covariances (n, 4, 4), or of none.

        `std_slides`: σ of their template drifts (n,) px, and of the apparent turn that these cause; `others`: further
        fields.
        """
        n = len(z_px)
        std_drift_px, std_turn_rad = (np.zeros(n), 0.0) if std_slides is None else std_slides
        ids, points = state.tracks.ids[:n], state.tracks.points[:n]
        errors, timing = state.errors.after(ids, z_px, cov_px), state.timing
        timing_px = np.zeros((n, 4)) if timing.twist is None else timing.taken_out(points, timing.twist)
        observed = Observations(
            frame_index=state.frame_index,
            stamp_ns=stamp_ns,
            track_ids=ids,
            z_px=self.rig.as_refined(z_px),
            cov_px=cov_px,
            note=note or _misfit(state),
            lasting=LastingErrors(std_drift_px, errors.inflation, std_turn_rad),
            rig=None
            if self.setup.config.rig.exact
            else RigView(
                self.rig,
                state.rows.field_std_px,
                timing_px,
                state.rows.delay,
                state.turn_root,
                np.zeros(0) if state.turn_watch is None else state.turn_watch.larger,
            ),
            **{"ambiguity": _ambiguity(None, state)} | others,
        )
        return changed(state, errors=errors), observed

    def _note(self, state: FrontEndState, images: PreparedImages, z_px: Array) -> str:
        """Return what is wrong with the images, given the views (n, 4) of all tracks; or an empty string."""
        rules = self.setup.rules.of(ImageRules)
        points = state.tracks.points
        if np.count_nonzero(are_laid_over(self.setup, points)) > rules.overlay_share * len(points):
            return _LAID_OVER
        n_in_both = int(np.count_nonzero(np.isfinite(z_px[:, 2])))
        enough = self.setup.rules.of(RobustRules).min_inliers
        return image_note(images, state.previous, len(z_px), n_in_both, enough, rules)

    def learn(self, state: FrontEndState, estimate: RigEstimate) -> FrontEndState:
        """Return the state updated with an estimator's latest estimate of the rig, in units of σ."""
        step_px = self.setup.config.rig.disparity_step_px
        state = changed(state, disparity=DisparityError.of(self.rig, estimate, step_px))
        return learn_timing(self.setup.projection, state, *self.rig.timing(estimate))

    def rig_in_px(self, turn_rad: Array, estimate: RigEstimate | None) -> RigEstimate | None:
        """Return the rig estimate, given in units of σ, in pixels, with a turn (3,) of the right camera added."""
        if estimate is None:
            return None
        found = self.rig.in_units(estimate)
        return found if not turn_rad.any() else with_turn(self.rig, found, turn_rad)


def _seen(state: FrontEndState, images: PreparedImages, stamp_ns: int, z_px: Array) -> FrontEndState:
    """Return the state from which the next frame is followed, its image checks updated by all views (n, 4)."""
    pictures = state.pictures.after(images, state.tracks.ids[: len(z_px)], z_px[:, :2])
    return changed(state.followed_from(images, stamp_ns), pictures=pictures)


def _ambiguity(second: SecondMotion | None, state: FrontEndState) -> Ambiguity | None:
    """Return why a frame's motion may not be the camera's: another one may be, or its images are inconsistent."""
    misfit, of_start = bool(_misfit(state)), bool(state.start.problem)
    if second is not None:
        return Ambiguity(second.cam_from_ref, second.cov_pose, misfit, of_start)
    return Ambiguity(misfit=True, of_start=of_start) if misfit else None


def _misfit(state: FrontEndState) -> str:
    """Return why the agreeing points may not be the scene, or an empty string."""
    return state.pair.problem or state.start.problem
