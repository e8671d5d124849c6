"""The cross-frame window: all motions of the last b frames estimated together, with a joint camera-centred prior.

One minimum gives the camera-centred (CC) structure and its covariance directly, and the world-centred (WC) pose and
structure through the uncertainty of the world itself. Source: Weng, Cui and Ahuja, sections 2 and 3; see
docs/mathematics.md, sections 5 to 7.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...config import Config, RigConfig
from ...config.rules import Rules
from ...geometry import Array, se3
from ...geometry.point_views import PointViews
from ...geometry.resection import Resection
from ...geometry.robust_rules import RobustRules
from ...geometry.sizes import Sizes
from ...geometry.stereo import StereoProjection
from ...geometry.view_stages import CorrectedViews
from ...record import changed, columns_at
from ...rig_model.terms import DELAY, TERMS
from ...types import Ambiguity, InertialEstimate, Observations, Solution
from ..initial_motion import initial_motion
from ..lifecycle import (
    LostError,
    first_solution,
    frame_status,
    lost_solution,
    recorded,
    too_few_inliers,
    with_ended,
)
from .absorb import absorbed_oldest, with_rig_change
from .enter import begun, entered, settled, with_rejected, with_second
from .inertia.inertia import Inertia, NotTheCameraError
from .inertia.takes_samples import InertialMotionModel, TakesSamples
from .inverse_depth import WhitenedViews
from .minimise import minimised
from .reported.equal_weights import reported
from .reported.followed import followed
from .reported.halves import SpanFactors
from .reported.relative import common_errors, newest_motion, relative_motions
from .reported.rules import ReportedRules
from .reported.track_noise import TrackNoise
from .rig import judged_rig, learnt_rig, with_field
from .rig_state import NO_RIG, RigState, impossible
from .state import WindowState
from .unknowns.focus import own_at_first, placed_focus, with_focus_at_rest
from .unknowns.twist import learnt_twists
from .unknowns.velocities import expect, renewed_timing
from .unknowns.weighing import weigh_unknowns
from .window_frame import WindowFrame, views_of


class CrossFrame(TakesSamples):
    """The default estimator (see `Estimator`)."""

    name = "cross-frame"

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self.projection = projection
        self.config, self._robust = config, config.rules.of(RobustRules)
        self.inertia = Inertia(config)
        self.motion = InertialMotionModel(config, self.inertia)
        self.map: WindowState | None = None
        self.rig: RigState | None = None  # of the latest map
        self.waiting = False  # for tracks of the map to return, since a frame without any view
        self._has_field = False
        self._factors = SpanFactors.unknown(config.window.frames, config.rules.of(ReportedRules))
        self._noise = TrackNoise.unknown(config.rules.of(ReportedRules))
        self._known_by_rows = np.zeros(2)  # information about the delay, and its weighted sum
        self._sizes = [Sizes(), Sizes()]  # of turns and of errors of twists, in usual ones
        self._is_ambiguous = False  # whether the motion to the latest estimated frame is ambiguous
        self._impossible = ""  # why the calibration cannot be right; empty if it can

    def step(self, observations: Observations) -> Solution:
        """Process the next frame; see `Estimator.step`."""
        self.inertia.take(observations.inertial, observations.stamp_ns)
        try:
            solution = self._take(observations)
        except np.linalg.LinAlgError:
            solution = self._lose(observations, "the views do not determine the motion")
        return self.by_inertia_if_lost(solution, observations.stamp_ns)

    def _take(self, observations: Observations) -> Solution:
        """Start a map or estimate the next frame. Raises LinAlgError if the views do not determine the motion."""
        observations = self._with_errors_in_use(observations)
        age_s = 0.0 if self.map is None else self.map.prior.rig.age_s(observations.stamp_ns)
        model = None if observations.rig is None else observations.rig.model
        stamp_ns, std_turn_rad = observations.stamp_ns, observations.lasting.std_turn_rad
        frame = WindowFrame(observations.frame_index, stamp_ns, model, std_turn_rad, misfit=observations.misfit)
        views = views_of(observations, self.projection, age_s)
        if observations.rig is not None and observations.rig.change_root is not None:
            self._change_rig(partial(RigState.changed, root=observations.rig.change_root))
        if self.map is None:
            return self._start(observations, frame, views)
        self.map = with_focus_at_rest(self.map)
        try:
            return self._advance(self.map, observations, frame, views)
        except LostError as lost:
            if self._is_ambiguous:
                self.inertia.forget()
            if not len(observations.track_ids):  # the map continues if its tracks return
                self.waiting = True
                return lost_solution(observations, str(lost), *self.motion.predict(observations.stamp_ns))
            if not self.waiting:
                return self._lose(observations, str(lost), blames_rig=not isinstance(lost, NotTheCameraError))
            # its tracks did not return: a new map begins with the new ones
            current, self.map = self.map, None
            self.rig = current.rig_left
            return with_ended(self._start(observations, frame, views), current.marginals.ended())

    def _start(self, observations: Observations, frame: WindowFrame, views: WhitenedViews) -> Solution:
        """Begin a map in this camera: at the world's origin in the very first frame, else at the predicted pose."""
        self.waiting = False
        rig = _unknown_rig(observations, self.config.rig) if self.rig is None else self.rig
        self.rig = rig.informed(*self._since_by_rows(observations, len(rig)))
        corrected_px = _corrected(observations, views, self.rig.mean)
        corrected = replace(observations, z_px=corrected_px)
        solution = first_solution(self.projection, self._robust, self.motion, corrected)
        if len(solution.track_ids):
            rules = self.config.window
            current = begun(self.projection, frame, views, corrected_px, solution, self.rig, rules)
            pose = solution.world_from_cam, solution.cov_pose
            self.map = self.inertia.begin(current, frame.stamp_ns, *pose)
        return solution

    def _advance(
        self, current: WindowState, observations: Observations, frame: WindowFrame, views: WhitenedViews
    ) -> Solution:
        """Estimate one frame with the current map. If that fails, the map is as after the last step that did not."""
        current, frame = self.inertia.enter(current, frame)
        self.map = current
        current, motion, rejected, views, corrected_px = self._initial_motion(current, observations, frame, views)
        self.map = current
        motion, frame = self.inertia.judge(motion, changed(frame, twist_size=self._sizes[-1].probable))
        current = changed(current, rejections=current.rejections.of_live(views.ids))
        if len(current.frames) == self.config.window.frames:
            current = absorbed_oldest(current)
        self.waiting = False
        if motion.ambiguous is None:  # otherwise rejected tracks may be right after all
            current = with_rejected(current, rejected)
        cam_from_ref = se3.orthonormalise(motion.cam_from_ref @ current.newest_cam_from_ref)
        own = own_at_first(current, motion)
        current = entered(current, frame, cam_from_ref, views, _without_own(corrected_px, views, own), rejected, own)
        current = placed_focus(current)
        passed_s = (observations.stamp_ns - current.all_frames[-2].stamp_ns) / 1e9
        current = with_second(current, motion, self.motion.std_speed * passed_s)
        if observations.settled:
            current = settled(current)
        self.map = current = renewed_timing(current)
        current, iterations = minimised(current, self.config.window, self._robust.gate_probability)
        return self._report(current, observations, motion, iterations)

    def _change_rig(self, change: Callable[[RigState], tuple[RigState, Array, Array]]) -> None:
        """Change the rig's errors since the last frame; earlier views have the old errors."""
        if self.map is not None:
            self.map = with_rig_change(self.map, change)
        elif self.rig is not None:
            self.rig = change(self.rig)[0]

    def _with_errors_in_use(self, observations: Observations) -> Observations:
        """Return the observations with the rig model in use: a field or a zoom only once one has shown."""
        view = observations.rig
        if view is None:
            return observations
        if view.field_std_px > self.config.window.least_field_px and not self._has_field:
            self._has_field = True
            if self.map is not None:
                self.map = with_field(self.map, view.model)
            elif self.rig is not None:
                self.rig = self.rig.with_field(len(view.model) - len(self.rig))
        rig = self.rig if self.map is None else self.map.prior.rig
        if rig is not None and rig.zooms:
            view = replace(view, model=view.model.zooming())
        if not self._has_field:
            root = None if view.change_root is None else view.change_root[: len(TERMS)]
            view = replace(view, model=view.model.without_field(), change_root=root)
        return replace(observations, rig=view)

    def _since_by_rows(self, observations: Observations, m: int) -> tuple[Array, Array]:
        """Return the new information (m,) about the rig's errors from image rows, and its weighted sums (m,).

        Rows show the delay for any depth and motion, and nothing else. If they contain less information than before,
        none is subtracted: the rig may have changed since, and the earlier information may be gone.
        """
        more, weighted = np.zeros((2, m))
        if (view := observations.rig) is not None:
            at, from_rows = TERMS.index(DELAY), view.model.amplitudes(DELAY, *view.delay_by_rows)
            if from_rows[0] > self._known_by_rows[0]:
                more[at], weighted[at] = from_rows - self._known_by_rows
                self._known_by_rows = from_rows
        return more, weighted

    def _lose(self, observations: Observations, reason: str, blames_rig: bool = True) -> Solution:
        """End the map, and predict the pose.

        The rig becomes unknown again if a map could not begin or not continue even once, or if its errors are
        impossible.
        """
        current, self.map = self.map, None
        if observations.jumped:
            self.motion.jump()
        predicted = self.motion.predict(observations.stamp_ns)
        if current is None or (blames_rig and not current.frames) or self._impossible:
            self.rig, self._known_by_rows, self._impossible = None, np.zeros(2), ""
        else:
            self.rig = current.rig_left
        ended = None if current is None else current.marginals.ended()
        return lost_solution(observations, reason, *predicted, ended)

    def _initial_motion(
        self, current: WindowState, observations: Observations, frame: WindowFrame, views: WhitenedViews
    ) -> tuple[WindowState, Resection, NDArray[np.int64], WhitenedViews, CorrectedViews]:
        """Find cam_n_from_cam_{n−1} from the local structure of the previous frame, and the tracks it rejects.

        Also returns the state, which has learnt from that motion, the views with the effects of delay and readout, and
        z_px without the rig's errors.
        """
        robust, previous = self._robust, current.marginals
        rows, points, cov = core.points_seen_again(
            views.ids, views.var_drift, previous.ids, previous.q_in_cam, previous.cov_q_in_cam
        )
        rows, points, cov = columns_at((rows, points, cov), ~current.rejections.excluded(views.ids[rows]))
        if len(rows) < robust.min_inliers:
            raise LostError(too_few_inliers(0, len(rows), robust))
        start = observations.cam_from_previous
        if start is None:
            predicted, _ = self.motion.predict(observations.stamp_ns)
            start = se3.inverse(predicted) @ previous.world_from_cam
        current, views, unknown_px = expect(current, frame, views, rows, points, start, self.config.motion)
        corrected_px = _corrected(observations, views, current.rig_error)
        weights = self.config.window.no_history + _frames_agreed(current, views.ids[rows])
        z_px, cov_px = CorrectedViews(corrected_px[rows]), observations.cov_px[rows]
        seen = PointViews(self.projection, points, cov, z_px, cov_px, robust, unknown_px)
        found = initial_motion(seen, observations, start, weights, _first_amplitudes(observations, unknown_px))
        if found is None:
            raise LostError(f"no motion agrees with {robust.min_inliers} or more of the {len(rows)} tracked points")
        if unknown_px is not None:
            of = views, rows, seen, weights, found
            current, self._sizes, views, found = weigh_unknowns(current, self._sizes, *of)
        return current, found, views.ids[rows[~found.accepted]], views, corrected_px

    def _with_marginals(
        self, current: WindowState, smoothed: WindowState, ambiguous: bool
    ) -> tuple[WindowState, InertialEstimate | None]:
        """Return the state with the marginals to report, and the inertial state if there is one.

        If the motion is `ambiguous`, the filter's pose is reported.
        """
        before = current.marginals
        # all correlated errors have moved the world, and only the weights of eq. (69) account for them
        now = changed(smoothed.newest_marginals(), cov_pose=current.cov_pose)
        known, inertial = self.inertia.report(current, smoothed)
        if known is not None:
            now = now.at(known.world_from_cam, known.cov_pose + current.cov_ambiguous)
        if not ambiguous:
            frames, most_sigmas = self.config.window.frames, self.config.rules.of(ReportedRules).most_followed
            now = followed(before, now, newest_motion(smoothed), frames, most_sigmas)
            inertial = self.inertia.placed(inertial, now.world_from_cam)
        return changed(current, read=now), inertial

    def _report(self, current: WindowState, observations: Observations, motion: Resection, iterations: int) -> Solution:
        """Return the Solution from the joint covariance, and give the pose to the motion model."""
        current, rig = judged_rig(current)
        self._is_ambiguous = motion.ambiguous is not None
        before, rules, ambiguous = current.marginals, self.config.rules, self._is_ambiguous or observations.misfit
        informative = observations.lasting.inflation is not None and not ambiguous
        smoothed, self._factors, self._noise = reported(current, self._factors, self._noise, informative)
        current, inertial = self._with_marginals(current, smoothed, ambiguous)
        current = learnt_twists(current)
        if motion.ambiguous is None:  # otherwise the motion may be wrong instead
            self._impossible = impossible(rig, self.config.rig)
        observations = _with_misfit(observations, self._impossible)
        observations = _with_note(observations, self.inertia.contradiction)
        solution = replace(
            _solution_of(current, smoothed, before.ids, observations, motion, rules),
            iterations=iterations,
            rig=rig,
            relative=relative_motions(smoothed, self._factors.by_span, rules.of(ReportedRules).apparent_turns),
            common=common_errors(smoothed, rig),
            inertial=inertial,
        )
        solution = replace(solution, cov_pose=solution.cov_pose + current.focus.cov_axes)
        if rig is not None and observations.rig is not None:
            by_rows = self._since_by_rows(observations, len(rig.mean))
            current = learnt_rig(current, rig, observations.rig.field_std_px, by_rows)
        self.map = current
        return recorded(self.motion, observations, solution, before.ended(current.points.ids))


class PlainCrossFrame(CrossFrame):
    """The same filter without the weights of eq. (69): views count by their covariances alone, as in an EKF."""

    def step(self, observations: Observations) -> Solution:
        """Process the next frame; see `Estimator.step`."""
        return super().step(replace(observations, lasting=replace(observations.lasting, inflation=None)))


def _solution_of(
    current: WindowState,
    smoothed: WindowState,
    known: NDArray[np.int64],
    observations: Observations,
    motion: Resection,
    rules: Rules,
) -> Solution:
    """Return the status of the newest frame with the marginals and the window's poses; `known`: points before it."""
    now, ids, used = current.marginals, current.views.ids[current.newest], current.views.used[current.newest]
    sought = core.among(ids, known) & ~current.rejections.excluded(ids)
    counts = int(np.count_nonzero(used & sought)), int(np.count_nonzero(sought))  # accepted by the joint minimum, too
    status, reason = frame_status(*counts, observations.note, rules.of(RobustRules), motion)
    shown = core.among(now.ids, ids[used]) & now.finite
    shown &= ~core.among(now.ids, current.restarted)
    columns = now.points_in_cam, now.cov_points, now.points_in_world, now.cov_points_in_world
    points_in_cam, cov_points, points_in_world, cov_points_in_world = columns_at(columns, shown)
    return Solution(
        status=status,
        reason=reason,
        world_from_cam=now.world_from_cam,
        cov_pose=now.cov_pose,
        track_ids=now.ids[shown],
        points_in_cam=points_in_cam,
        cov_points=cov_points,
        points_in_world=points_in_world,
        cov_points_in_world=cov_points_in_world,
        window_frame_indices=np.array([f.index for f in current.frames], np.int64),
        window_world_from_cam=now.world_from_cam @ smoothed.true_cams[-1] @ se3.inverse(smoothed.true_cams),
        rejected_ids=ids[~used],
        nis=motion.chi2,
        nis_dof=motion.dof,
    )


def _with_misfit(observations: Observations, reason: str) -> Observations:
    """Return the observations with one more reason why images and calibration do not fit, if there is one."""
    if not reason:
        return observations
    ambiguity = replace(observations.ambiguity or Ambiguity(), misfit=True)
    return _with_note(replace(observations, ambiguity=ambiguity), reason)


def _with_note(observations: Observations, note: str) -> Observations:
    """Return the observations with one more note, if there is one."""
    if not note:
        return observations
    return replace(observations, note=f"{observations.note}; {note}" if observations.note else note)


def _unknown_rig(observations: Observations, rules: RigConfig) -> RigState:
    """Return the knowledge of the rig before any view."""
    if observations.rig is None:
        return NO_RIG
    model = observations.rig.model
    mean, size, learnt = model.before_views()
    return RigState.unknown(size, learnt, observations.stamp_ns, mean, rules, model.refined)


def _first_amplitudes(observations: Observations, unknown_px: Array | None) -> Array | None:
    """Return the amplitudes (j,) of shared errors (n, 4, j) to begin with; None if all are zero."""
    if observations.rig is None or unknown_px is None:
        return None
    turn = observations.rig.turn
    return np.concatenate([turn, np.zeros(unknown_px.shape[2] - len(turn))])


def _frames_agreed(current: WindowState, ids: NDArray[np.int64]) -> Array:
    """Return in how many frames after their first one points `ids` (n,) agreed with the map.

    For a point older than the window, all frames of the window are counted once more.
    """
    count = core.times_among(ids, current.views.ids, current.views.used)
    more = np.where(core.among(ids, current.prior.ids), len(current.frames), -1)
    return np.maximum(count + more, 0).astype(float)


def _corrected(observations: Observations, views: WhitenedViews, rig_error: Array) -> CorrectedViews:
    """Return the views (V, 4) of a frame without errors (m,) of the rig, those of timing included."""
    shift_px = views.shift_px(rig_error) if rig_error.any() else 0.0
    return CorrectedViews(observations.z_px - shift_px)


def _without_own(corrected_px: CorrectedViews, views: WhitenedViews, own: Array) -> CorrectedViews:
    """Return views (V, 4) without the errors that those of this frame share, of amplitudes `own` (1, e)."""
    return CorrectedViews(corrected_px - views.own @ own[0])
