"""The map of the window estimator: everything that exists only while the camera is tracked.

The reference camera p is the newest frame that has left the window; frames p+1 … n are in it with poses cam_from_ref.
Points are given by q in the cameras that first saw them (`inverse_depth`); the world is one more pose, which the prior
contains.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...config import WindowConfig
from ...geometry import Array, se3
from ...geometry.gates import chi2_gate
from ...geometry.linear import symmetric
from ...geometry.resection import Resection
from ...geometry.stereo import StereoProjection
from ...inertial.state import GRAVITY
from ...record import changed, rows_of
from ...rig_model.estimate import RigEstimate
from ...rig_model.model import RigModel
from ...types import Solution
from .doubt import Doubt
from .focus_watch import FocusWatch
from .inertial_window import InertialWindow
from .interval import JOINT, Known
from .inverse_depth import State, WhitenedViews, at_rest, expected, held, linearise, q_of_views, slides_px2
from .map_points import MapPoints
from .marginals import Marginals
from .normal_equations import System
from .outliers import RejectionCounts
from .prior import Prior
from .rig_state import RigState
from .timing import Exposures
from .window_frame import WindowFrame


class Map:
    """Points, poses and prior of one map, with their latest joint covariance.

    `points`: all points of the map; `restarted`: ids of those that the newest frame started again, from a single view.
    `frames`: the window, oldest first; `views`: all views of these frames in their order, used or not; `cams_from_ref`
    (F, 4, 4): their poses; `own` (F, e): amplitudes of the errors that the views of each frame share, in σ.
    `reference`: the frame of the reference camera; `first_views`: its views while nothing else is in the prior.
    `exposures`: when frames were exposed; `doubt`: further uncertainty of the newest pose. `prior`, and the
    `amplitudes` (k,) of its modes. `system`: the latest normal equations, factored. `marginals`: of the latest frame,
    as reported.
    """

    def __init__(
        self,
        projection: StereoProjection,
        frame: WindowFrame,
        views: WhitenedViews,
        corrected_px: Array,
        first: Solution,
        rig: RigState,
        rules: WindowConfig,
    ) -> None:
        """Begin a map in the camera of `frame`, which becomes the reference.

        `first` contains the ids of those `views` that start points; `corrected_px` (V, 4): the views without the rig's
        errors; `rig`: the knowledge of these errors.
        """
        self.projection = projection
        self.frames: list[WindowFrame] = []
        self.views, self.cams_from_ref, self.own = views[:0], np.empty((0, 4, 4)), np.empty((0, views.own.shape[2]))
        self.reference, self.exposures = frame, Exposures.of_reference()
        self.rules, self.rejections = rules, RejectionCounts(rig.held, rules)
        self.restarted = self._dropped = np.empty(0, np.int64)
        self.doubt = Doubt()
        self.focus, self.has_focus = FocusWatch.begun(rig.rules), False
        ids = first.track_ids
        views = changed(views, used=core.among(views.ids, ids))
        self.first_views: WhitenedViews | None = views
        self._places = views.ids, views.expected_px  # of the newest frame's tracks
        points = MapPoints.of_reference(ids, q_of_views(projection, corrected_px[views.used]))
        q, cov, by_own, by_rig = self.seen_alone(views, self.state_of_one(points, rig.mean), np.zeros(len(rig)))
        self.points, pose = changed(points, q=q), (first.world_from_cam, first.cov_pose)
        self.prior = Prior.from_first_frame(ids, q, cov, by_own, by_rig, *pose, rig)
        self.inertia: InertialWindow | None = None
        self.marginals: Marginals
        self.amplitudes = np.zeros(self.prior.modes.shape[2])
        self.gauss_newton_step()
        self.update_marginals()

    @property
    def world_from_ref(self) -> Array:
        """The pose (4, 4) of the reference camera at the current amplitudes of the prior's modes."""
        return self.prior.world(self.amplitudes)

    @property
    def rig_error(self) -> Array:
        """The errors (m,) of the rig at the current amplitudes, which are removed from the views."""
        return self.prior.rig_at(self.amplitudes)

    @property
    def inertial_state(self) -> Array:
        """The inertial state (17,) of the reference camera at the current amplitudes; (0,) without inertia."""
        return self.prior.state_at(self.amplitudes)

    @property
    def previous(self) -> WindowFrame:
        """The frame before the newest one."""
        return self.frames[-2] if len(self.frames) > 1 else self.reference

    @property
    def newest_cam_from_ref(self) -> Array:
        """The pose (4, 4) of the newest camera, which is the reference until there is a second frame."""
        return self.cams_from_ref[-1] if self.frames else np.eye(4)

    def state(self) -> State:
        """Return the state that views are predicted from."""
        points = self.points
        return State(self.cams_from_ref, points.ids, points.ref_from_anchor, points.q, self.rig_error, self.own)

    def state_of_one(self, points: MapPoints, rig_error: Array, own: Array | None = None) -> State:
        """Return the state for views of the reference camera alone, with its `own` amplitudes (1, e)."""
        own = np.zeros((1, self.own.shape[1])) if own is None else own
        return State(np.eye(4)[None], points.ids, points.ref_from_anchor, points.q, rig_error, own)

    def seen_alone(self, views: WhitenedViews, state: State, rig_step: Array) -> tuple[Array, Array, Array, Array]:
        """Return the points of a state estimated from views of the reference camera alone; see `core.points_alone`."""
        blocks = linearise(self.projection, state, views)
        return core.points_alone(blocks.v, blocks.w, blocks.g_point, blocks.rig_point, state.q, rig_step)

    @property
    def rig_left(self) -> RigState:
        """The rig that the next map begins with; a focal length that is changing becomes unknown."""
        return self.prior.rig.refocused()[0] if self.focus.moves else self.prior.rig

    @property
    def newest(self) -> slice:
        """The rows of the newest frame's views."""
        return slice(int(np.searchsorted(self.views.frame, len(self.frames) - 1)), len(self.views))

    def absorb_oldest(self) -> None:
        """Marginalise the oldest frame, eqs. (31)–(36): the prior then contains all information of earlier frames."""
        cam_from_ref, own, leaving = self.cams_from_ref[0], self.own[:1], None
        if self.inertia is not None:
            of_gravity = self.prior.world_modes[JOINT.within("state", GRAVITY)]
            leaving = self.inertia.leaving(cam_from_ref, self.inertial_state, of_gravity @ of_gravity.T)
        frame, views = self._remove_oldest()
        prior, later = self.prior, self.views if self.frames else views
        seen_later = core.times_among(self.points.ids, later.ids, later.used) > 0
        known = np.searchsorted(self.points.ids, prior.ids)
        in_reference, seen = self.state_of_one(self.points, self.rig_error, own), (views.stereo, views.var_drift)
        rows, stays, cov, anchors, q, blocks, new_ids, alone = core.leaving_views(
            self.projection, in_reference, views, *seen, seen_later, known, prior.cov
        )
        if len(rows) < len(known):
            prior = changed(prior, ids=prior.ids[rows], mean=prior.mean[rows], modes=rows_of(prior.modes, rows))
        prior = changed(prior, cov=cov).absorb_frame(
            self.amplitudes, cam_from_ref, anchors, q, blocks, stays, (new_ids, *alone), leaving
        )
        prior = changed(prior.truncate_modes(), rig=prior.rig.with_part(not frame.in_question))
        self.prior = prior.refocused(frame, self.frames[0].stamp_ns) if self.frames else prior
        self.amplitudes = np.zeros(self.prior.modes.shape[2])
        self.points = self.points.keep(seen_later if self.frames else core.among(self.points.ids, self.prior.ids))

    def _absorb_all(self) -> None:
        """Empty the window: the newest camera becomes the reference."""
        while self.frames:
            self.absorb_oldest()

    def _remove_oldest(self) -> tuple[WindowFrame, WhitenedViews]:
        """Remove and return the oldest frame of the window with its views; it becomes the reference camera."""
        n = int(np.searchsorted(self.views.frame, 1))
        views, later = self.views[:n], self.views[n:]
        self.views = changed(later, frame=later.frame - 1)
        frame, cam_from_ref = self.frames.pop(0), self.cams_from_ref[0]
        self.first_views = None  # its views stay in the prior as they are
        self.reference = frame
        if self.inertia is not None:
            self.inertia.drop_oldest()
        self.exposures = changed(self.exposures, seconds=self.exposures.seconds[1:])
        self.doubt, self.points = self.doubt.seen_from(cam_from_ref), self.points.seen_from(cam_from_ref)
        self.cams_from_ref = se3.orthonormalise(self.cams_from_ref[1:] @ se3.inverse(cam_from_ref))
        self.own = self.own[1:]
        return frame, views

    def enter(
        self,
        frame: WindowFrame,
        cam_from_ref: Array,
        views: WhitenedViews,
        corrected_px: Array,
        rejected: NDArray[np.int64],
        ambiguous: bool,
        own: Array,
    ) -> None:
        """Add the newest frame to the window, without the views of `rejected` tracks.

        Points that are not in the map yet start at their stereo view; `corrected_px` (V, 4): the views without the
        rig's errors. If the motion is `ambiguous`, rejected tracks may be right after all, and no rejection is counted.
        `own` (1, e): initial amplitudes of the errors that the views share.
        """
        if not ambiguous:
            self._count_rejected(rejected)
        wanted = ~(self.rejections.excluded(views.ids) | core.among(views.ids, rejected))
        known = core.among(views.ids, self.points.ids)
        new = ~known & views.stereo & wanted
        again = core.among(self._dropped, views.ids[new])
        self.restarted, self._dropped = self._dropped[again], self._dropped[~again]
        q = q_of_views(self.projection, corrected_px[new])
        self.points = self.points.with_new(views.ids[new], q, se3.inverse(cam_from_ref))
        views = changed(views, frame=np.full(len(views), len(self.frames)), used=(known | new) & wanted)
        self.frames.append(frame)
        self.cams_from_ref = np.concatenate([self.cams_from_ref, cam_from_ref[None]])
        self.own = np.concatenate([self.own, own])
        if self.inertia is not None and frame.interval is not None:  # which has slides as unknowns
            self.inertia.enter(frame.interval, frame.velocity, frame.std_turn_rad)
            frame.std_turn_rad = 0.0
        self.doubt = self.doubt.with_slide(cam_from_ref, frame.std_turn_rad)
        if frame.rig is not None:
            views = held(expected(self.state(), views, frame.rig), *self._places, self.rules.rests_px)
            views = at_rest(views, frame.rig, self.prior.rig.age_s(frame.stamp_ns))
            self._places = views.ids, views.expected_px
        # unused views are never used again: of these, only the drift of points in the map is needed
        kept = np.flatnonzero(self.views.used | core.among(self.views.ids, self.points.ids))
        self.views = self.views.with_newest(kept, views)

    def _count_rejected(self, rejected: NDArray[np.int64]) -> None:
        """Count the tracks that disagree with the motion.

        If a track has only one view in the map, that view may be the wrong one instead of the rejected one: the point
        is dropped, and starts again with the track's next view.
        """
        seen = core.times_among(rejected, self.views.ids, self.views.used)
        young = rejected[(seen <= 1) & ~core.among(rejected, self.prior.ids)]
        self.rejections.add(rejected)
        if len(young):
            self.views = changed(self.views, used=self.views.used & ~core.among(self.views.ids, young))
            self.points = self.points.keep(~core.among(self.points.ids, young))
            self._dropped = core.union_of(np.concatenate([self._dropped, young]))

    def consider_second(self, motion: Resection, std_moved: Array) -> None:
        """Add the uncertainty from the second of two plausible motions, which may be the true one; see `Doubt`."""
        fewest = 1 if motion.ambiguous is None else 2
        seen = self.newest_cam_from_ref, self._agreeing(fewest)
        self.doubt, ambiguity = self.doubt.with_second(motion, std_moved, *seen)
        if motion.ambiguous is None or ambiguity is None:
            return
        for frame in self.frames[-1 - motion.ambiguous.lasted :]:
            if frame is self.frames[-1] or not frame.ambiguity.shape[1]:
                frame.ambiguity = ambiguity

    def settle(self) -> None:
        """Drop the uncertainty about second motions as far back as tracks confirm the motions that were followed."""
        n, ambiguous = len(self.doubt.motions), [f for f in self.frames if f.ambiguity.shape[1]]
        self.doubt, confirmed = self.doubt.settled()
        first = 0 if confirmed == n else max(len(ambiguous) - confirmed, 0)
        for frame in ambiguous[first:]:
            frame.ambiguity = np.zeros((6, 0))

    def _agreeing(self, fewest: int) -> NDArray[np.int64]:
        """Return the ascending ids of the newest frame's used views of points that have so many of them in the map."""
        ids = self.views.ids[self.newest][self.views.used[self.newest]]
        seen = core.times_among(ids, self.views.ids, self.views.used) >= fewest
        return ids[seen | core.among(ids, self.prior.ids)]

    @property
    def cov_doubt(self) -> Array:
        """The covariance (6, 6) that second motions, and patches that slide alike, add to the newest pose."""
        return self.doubt.of_newest(self.newest_cam_from_ref)

    def drop_undetermined(self) -> None:
        """Drop points that neither the prior nor an accepted stereo view of the window determines.

        Points that ended after a single view are dropped too, as one view contains no information about anything else.
        """
        views, known = self.views, self.prior.ids
        seen = views.ids, views.used, views.stereo, self.newest.start
        keep = core.determined_points(self.points.ids, known, *seen)
        if not keep.all():
            self.points = self.points.keep(keep)
            self.views = changed(views, used=views.used & core.among(views.ids, self.points.ids))

    def gauss_newton_step(self) -> float:
        """Move poses, points and modes by one step, and return the predicted decrease of the sum of squares."""
        blocks = linearise(self.projection, self.state(), self.views)
        known = np.searchsorted(self.points.ids, self.prior.ids)
        inertial = None
        if self.inertia is not None and self.frames:
            inertial = self.inertia.linearise(self.cams_from_ref, self.inertial_state)
        self.system = System(self.prior, known, blocks, self.points.q, self.amplitudes, inertial)
        *change, decrease = self.system.step()
        self._move(*change)
        return decrease

    def gate(self, probability: float) -> None:
        """Stop using the views that contradict the joint minimum, each by its own covariance and slide, eq. (26a)."""
        gates = chi2_gate(2, probability), chi2_gate(4, probability)
        slides = slides_px2(self.projection, self.views)
        used = core.views_within_gates(self.projection, self.state(), self.views, slides, *gates)
        self.rejections.add(self.views.ids[self.views.used & ~used])
        self.views = changed(self.views, used=used)

    def follow(self, system: System) -> None:
        """Move to the minimum of a system with the current errors of the rig, and keep the system."""
        dx, down, dq, dy, _ = system.step()
        self._move(dx, down, dq, np.concatenate([dy, np.zeros(len(self.prior.rig))]))
        self.system = system

    def _move(self, dx: Array, down: Array, dq: Array, dy: Array) -> None:
        """Move poses by (F, 6), amplitudes of the frames by (F, e), points by (P, 3) and those of the modes by (k,)."""
        if self.inertia is not None and self.frames:
            self.inertia.follow(dx, self.prior.world_modes[JOINT["state"]] @ dy)
        self.cams_from_ref = se3.orthonormalise(se3.exp(dx) @ self.cams_from_ref)
        self.own, self.points, self.amplitudes = self.own + down, self.points.moved(dq), self.amplitudes + dy

    def judge_rig(self) -> RigEstimate | None:
        """Return the rig's errors as estimated by the latest system, and hold them there; None for an exact rig."""
        if not len(self.prior.rig):
            return None
        rig, model = self.prior.rig, self.frames[-1].rig
        mean, cov, information = self.system.rig_errors()
        changes = not rig.steady or (model is not None and model.focus_moves(mean, cov))
        agreement = rig.parts.agreement
        counted = (mean, cov) if changes else rig.tempered(mean, cov, information)
        rig, found = rig.contradicted(mean, cov).judged(*counted, agreement)
        self._move(*self.system.follow_rig(rig.held - self.rig_error))
        self.prior = changed(self.prior, rig=rig)
        self.rejections.ask_again(self.views[self.newest], rig.held)
        self.system.cov_rig = found.cov
        age = rig.age_s(self.frames[-1].stamp_ns)
        by_parts = (None, None) if agreement is None else (agreement.evidence, agreement.thirds)
        return RigEstimate(found.mean, found.cov, found.p_wrong, mean, cov, rig.size, None, age, *by_parts)

    def learn_rig(self, estimate: RigEstimate, field_std_px: float, by_rows: tuple[Array, Array]) -> None:
        """Update the prior of the rig's errors: their sizes by the estimate, and the information from image rows.

        `by_rows`: information (m,) and weighted sums (m,).
        """
        rig = self.prior.rig.learnt(estimate.mean_if_wrong, estimate.cov_if_wrong, field_std_px, *by_rows)
        self.prior = changed(self.prior, rig=rig)

    def begin_field(self, model: RigModel) -> None:
        """Add a field to the rig's errors, and its effect on the views of the window."""
        for frame in self.frames:
            frame.rig = model
        self.views = changed(self.views, field=model.field_at(self.views.expected_px))
        if (first := self.first_views) is not None:
            self.first_views = changed(first, field=model.field_at(first.z_px))
        self.prior = self.prior.with_field(len(model) - len(self.prior.rig))
        self.amplitudes = np.pad(self.amplitudes, (0, self.prior.modes.shape[2] - len(self.amplitudes)))

    def change_rig(self, change: Callable[[RigState], tuple[RigState, Array, Array]]) -> None:
        """Change the errors of the rig after the newest frame, by the function `change`.

        Earlier views have the old errors, so all frames of the window are absorbed.
        """
        self._absorb_all()
        self.first_views = None  # its views have the old errors
        self.prior = self.prior.with_rig_change(change(self.prior.rig))
        self.amplitudes = np.zeros(self.prior.modes.shape[2])

    def begin_inertia(self, window: InertialWindow, known: Known) -> None:
        """Add an inertial state, `known` in the newest camera, or replace it; that camera becomes the reference."""
        self._absorb_all()
        self._begin_with(self.prior.without_state().with_state(known.state, known.cov), window)

    def end_inertia(self) -> None:
        """Continue without inertia; its information about poses and points stays."""
        self._absorb_all()
        self._begin_with(self.prior.without_state(), None)

    def _begin_with(self, prior: Prior, inertia: InertialWindow | None) -> None:
        """Set prior and inertia, and solve in the reference camera with an empty window."""
        self.prior, self.inertia, self.amplitudes = prior, inertia, np.zeros(prior.modes.shape[2])
        self.gauss_newton_step()

    def place_newest(self, known: Known) -> Marginals:
        """Move the newest camera to the pose from images and inertia together; points keep their positions in it."""
        self.marginals = self.marginals.at(known.world_from_cam, known.cov_pose + self.cov_doubt)
        return self.marginals

    @property
    def true_cams(self) -> Array:
        """The cameras of the window (F, 4, 4), without apparent rotations by sliding patches if there is inertia."""
        return self.cams_from_ref if self.inertia is None else self.inertia.true_cams(self.cams_from_ref)

    @property
    def cov_pose(self) -> Array:
        """The covariance (6, 6) of the newest pose in the world from the latest system."""
        own, rig = self.system.pose_and_world(len(self.frames) - 1)
        by_both = np.concatenate([-np.eye(6), se3.adjoint(self.newest_cam_from_ref)], axis=1)
        own, rig = by_both @ own, by_both @ rig
        return symmetric(own @ own.T + rig @ self.system.cov_rig @ rig.T) + self.cov_doubt

    def update_marginals(self) -> Marginals:
        """Compute the marginals of the newest frame from the latest system."""
        marginals = Marginals.compute(self.system, self.state(), self.world_from_ref)
        self.marginals = marginals.doubted(self.cov_doubt)
        return self.marginals
