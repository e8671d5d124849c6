"""The map of the window estimator: everything that exists only while the camera is being followed.

The reference camera p is the newest frame that has left the window; frames p+1 … n are in it with poses cam_from_ref.
Points are q in the cameras that first saw them (`inverse_depth`); the world is one more pose, carried by the prior.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import se3
from ...geometry.gates import chi2_gate
from ...geometry.linear import Cholesky, scaled_cholesky, symmetric
from ...geometry.resection import Resection
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection, clamp_depth
from ...record import changed, rows_of
from ...rig_model.estimate import CERTAIN, RigEstimate
from ...rig_model.model import LEAST_VARIANCE, RigModel
from ...rig_model.terms import DISPARITY
from ...types import Solution
from .inertial_window import InertialWindow
from .interval import Known
from .inverse_depth import (
    NormalBlocks,
    State,
    WhitenedViews,
    at_rest,
    expected,
    held,
    linearise,
    q_of_views,
    timed,
)
from .marginals import Marginals
from .normal_equations import System
from .outliers import RejectionCounts
from .prior import Prior
from .rig_knowledge import RigKnowledge
from .timing import ExposureClock, TwistError
from .twist_unknown import TWIST, left_in_rows, twist_columns, with_room
from .window_frame import WindowFrame

_LEAST_TWIST = (
    0.1  # of what accelerations are assumed to do to a twist: few frames have not shown all of its errors
)
PROBABLE = 2.0  # standard deviations from which on a delay is reckoned with
FAR = 0.0, 0.0, 1.0, 0.0  # a point at infinity, straight ahead


class Map:
    """Points, poses and prior of one map, with their latest joint covariance.

    `ids` (P,) ascending, `q` (P, 3) and `ref_from_anchor` (P, 4, 4): every point; `begun_anew`: those that the newest
    frame began a second time, by one view. `frames`: the window, oldest first, and `views`: all of theirs, one after
    the other, used or not; `cams_from_ref` (F, 4, 4): their poses, and `own` (F, e): what the views of each err by in
    common, in σ. `reference`: the frame of the reference camera.
    `prior`, and the `amplitudes` (k,) of its modes. `system`: the latest normal equations, factored. `marginals`: of
    the latest frame, as reported.
    """

    def __init__(
        self,
        projection: StereoProjection,
        frame: WindowFrame,
        views: WhitenedViews,
        corrected_px: Array,
        first: Solution,
        rig: RigKnowledge,
    ) -> None:
        """Begin a map in the camera of `frame`, which becomes the reference.

        `first` says which of its `views` start points, which are `corrected_px` (V, 4) without the rig's errors; `rig`:
        what is known about these.
        """
        self.projection = projection
        self.frames: list[WindowFrame] = []
        self.views, self.cams_from_ref, self.own = views[:0], np.empty((0, 4, 4)), np.empty((0, views.own.shape[2]))
        self._clock, self._twist_error = ExposureClock(), TwistError()
        self._seconds = np.zeros(1)  # when the reference camera and the window exposed
        self._motions = np.zeros((1, 2, 6))  # of points in the reference camera and in the window
        self.reference = frame
        self.has_twist = (
            False  # whether the error of a frame's twist is one of its unknowns: where a delay is probable
        )
        self.rejections = RejectionCounts()
        self.begun_anew = self._dropped = np.empty(0, np.int64)
        self._frames_ambiguous, self._cov_doubt = 0, np.zeros((6, 6))  # in axes of the reference camera
        self._cov_slides = np.zeros((6, 6))  # of turns that patches have feigned which slid alike, in the same axes
        self.ids = first.track_ids
        views = changed(views, used=core.among(views.ids, self.ids))
        self._first: WhitenedViews | None = views  # of the reference camera, until another one is absorbed
        self._places = views.ids, views.expected_px  # of the newest frame's tracks
        self.q = q_of_views(projection, corrected_px[views.used])
        self.ref_from_anchor = np.tile(np.eye(4), (len(self.ids), 1, 1))
        state = self._state_of_one(self.ids, self.ref_from_anchor, self.q, rig.mean)
        self.q, cov, by_own, by_rig = self._seen_alone(views, state, np.zeros(len(rig)))
        pose = first.world_from_cam, first.cov_pose
        self.prior = Prior.from_first_frame(self.ids, self.q, cov, by_own, by_rig, *pose, rig)
        self.inertia: InertialWindow | None = None
        self.marginals: Marginals
        self.amplitudes = np.zeros(self.prior.modes.shape[2])
        self.gauss_newton_step()
        self.update_marginals()

    @property
    def world_from_ref(self) -> Array:
        """The pose (4, 4) of the reference camera at the present amplitudes of the prior's modes."""
        return self.prior.world(self.amplitudes)

    @property
    def rig_error(self) -> Array:
        """The errors (m,) of the rig that are taken out of the views at the present amplitudes."""
        return self.prior.rig.at(self.amplitudes[len(self.amplitudes) - len(self.prior.rig) :])

    @property
    def inertial_state(self) -> Array:
        """The inertial state (17,) of the reference camera at the present amplitudes; (0,) without inertia."""
        return self.prior.state_at(self.amplitudes)

    @property
    def previous(self) -> WindowFrame:
        """The frame before the newest one."""
        return self.frames[-2] if len(self.frames) > 1 else self.reference

    @property
    def newest_cam_from_ref(self) -> Array:
        """The pose (4, 4) of the newest camera; that is the reference until a second frame has come."""
        return self.cams_from_ref[-1] if self.frames else np.eye(4)

    def state(self) -> State:
        """Return what views are predicted from."""
        return State(self.cams_from_ref, self.ids, self.ref_from_anchor, self.q, self.rig_error, self.own)

    def _state_of_one(self, ids: NDArray[np.int64], ref_from_anchor: Array, q: Array, rig_error: Array) -> State:
        """Return what views of the reference camera alone are predicted from."""
        return State(np.eye(4)[None], ids, ref_from_anchor, q, rig_error, np.zeros((1, self.own.shape[1])))

    def _seen_alone(self, views: WhitenedViews, state: State, rig_step: Array) -> tuple[Array, Array, Array, Array]:
        """Return the points of a state by the reference camera's views alone, as `core.points_alone` does."""
        blocks = linearise(self.projection, state, views)
        return core.points_alone(blocks.v, blocks.w, blocks.g_point, blocks.rig_point, state.q, rig_step)

    @property
    def newest(self) -> slice:
        """The rows of the newest frame's views."""
        return slice(int(np.searchsorted(self.views.frame, len(self.frames) - 1)), len(self.views))

    def absorb_oldest(self) -> None:
        """Marginalise the oldest frame, eqs. (31)–(36): all that earlier frames say is in the prior again."""
        cam_from_ref, own, leaving = self.cams_from_ref[0], self.own[:1], None
        if self.inertia is not None:
            of_gravity = self.prior.world_modes[9:12]
            leaving = self.inertia.leaving(cam_from_ref, self.inertial_state, of_gravity @ of_gravity.T)
        frame, views = self._remove_oldest()
        prior, later = self.prior, self.views if self.frames else views
        seen_later = core.times_among(self.ids, later.ids, later.used) > 0
        known = np.searchsorted(self.ids, prior.ids)
        in_reference = State(np.eye(4)[None], self.ids, self.ref_from_anchor, self.q, self.rig_error, own)
        pinholes, seen = self.projection.pinholes, (views.of_core, views.stereo, views.var_drift)
        rows, stays, cov, anchors, q, blocks, new_ids, alone = core.leaving_views(
            pinholes, in_reference, *seen, seen_later, known, prior.cov
        )
        if len(rows) < len(known):
            prior = changed(prior, ids=prior.ids[rows], mean=prior.mean[rows], modes=rows_of(prior.modes, rows))
        prior = changed(prior, cov=cov).absorb_frame(
            self.amplitudes, cam_from_ref, anchors, q, NormalBlocks(*blocks), stays, (new_ids, *alone), leaving
        )
        prior = prior.truncate_modes()
        self.prior = self._refocused(changed(prior, rig=prior.rig.with_part(not frame.in_question)), frame)
        self.amplitudes = np.zeros(self.prior.modes.shape[2])
        self.select(seen_later if self.frames else core.among(self.ids, self.prior.ids))

    def _refocused(self, prior: Prior, frame: WindowFrame) -> Prior:
        """Return the prior with a focus that may have moved faster or slower since `frame`, if it moves at all."""
        if frame.rig is None or not self.frames:
            return prior
        passed_s = (self.frames[0].stamp_ns - frame.stamp_ns) / 1e9
        age_s = prior.rig.age_s(frame.stamp_ns)
        root = frame.rig.root_of_focusing(prior.rig.held, prior.rig.cov_held, age_s, passed_s)
        if not root.any():
            return prior
        if prior.rig.steady:  # until now its motion was taken for other errors, which are as unknown as at first
            root = np.concatenate([root, np.diag(prior.rig.size)], axis=1)
        return prior.with_rig_change(root)

    def _remove_oldest(self) -> tuple[WindowFrame, WhitenedViews]:
        """Take the oldest frame out of the window, with its views; it becomes the reference camera."""
        n = int(np.searchsorted(self.views.frame, 1))
        views, later = self.views[:n], self.views[n:]
        self.views = changed(later, frame=later.frame - 1)
        frame, cam_from_ref = self.frames.pop(0), self.cams_from_ref[0]
        self._first = None  # its views stay in the prior as they are
        self.reference = frame
        if self.inertia is not None:
            self.inertia.drop_oldest()
        self._seconds = self._seconds[1:]
        ad = se3.adjoint(cam_from_ref)
        self._cov_doubt, self._cov_slides = ad @ self._cov_doubt @ ad.T, ad @ self._cov_slides @ ad.T
        self.ref_from_anchor = se3.orthonormalise(cam_from_ref @ self.ref_from_anchor)
        self.cams_from_ref = se3.orthonormalise(self.cams_from_ref[1:] @ se3.inverse(cam_from_ref))
        self.own = self.own[1:]
        return frame, views

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> None:
        """Keep the points of a mask or of an order."""
        self.ids, self.q = rows_of(self.ids, rows), rows_of(self.q, rows)
        self.ref_from_anchor = rows_of(self.ref_from_anchor, rows)

    def enter(
        self,
        frame: WindowFrame,
        cam_from_ref: Array,
        views: WhitenedViews,
        corrected_px: Array,
        rejected: NDArray[np.int64],
        ambiguous: bool,
    ) -> None:
        """Add the newest frame to the window, without the views of `rejected` tracks.

        Points that the map does not hold yet start at their stereo view, which is `corrected_px` (V, 4) without the
        rig's errors. Where the motion is `ambiguous`, the tracks may be right another time, and nothing is held against
        them.
        """
        if not ambiguous:
            self._count_rejected(rejected)
        wanted = ~(self.rejections.excluded(views.ids) | core.among(views.ids, rejected))
        known = core.among(views.ids, self.ids)
        new = ~known & views.stereo & wanted
        again = core.among(self._dropped, views.ids[new])
        self.begun_anew, self._dropped = self._dropped[again], self._dropped[~again]
        ids = np.concatenate([self.ids, views.ids[new]])
        order = np.argsort(ids)
        ref_from_cam = np.broadcast_to(se3.inverse(cam_from_ref), (len(ids) - len(self.ids), 4, 4))
        q = q_of_views(self.projection, corrected_px[new])
        self.ids, self.q = ids[order], np.concatenate([self.q, q])[order]
        self.ref_from_anchor = np.concatenate([self.ref_from_anchor, ref_from_cam])[order]
        views = changed(views, frame=np.full(len(views), len(self.frames)), used=(known | new) & wanted)
        self.frames.append(frame)
        self.cams_from_ref = np.concatenate([self.cams_from_ref, cam_from_ref[None]])
        self.own = np.concatenate([self.own, np.zeros((1, self.own.shape[1]))])
        if self.inertia is not None and frame.interval is not None:  # where slides are unknowns
            self.inertia.enter(frame.interval, frame.velocity, frame.std_turn_rad)
            frame.std_turn_rad = 0.0
        turns = frame.std_turn_rad * se3.adjoint(se3.inverse(cam_from_ref))[:, 3:]
        self._cov_slides = self._cov_slides + turns @ turns.T
        if frame.rig is not None:
            views = held(expected(self.state(), views, frame.rig), *self._places)
            views = at_rest(views, frame.rig, self.prior.rig.age_s(frame.stamp_ns))
            self._places = views.ids, views.expected_px
        # views out of use stay so: only the drift of points that are in the map is asked for
        kept = np.flatnonzero(self.views.used | core.among(self.views.ids, self.ids))
        self.views = WhitenedViews.concatenate([self.views[kept], views])

    def _count_rejected(self, rejected: NDArray[np.int64]) -> None:
        """Remember which tracks disagree with the motion.

        Of a track with one view in the map that one view may be the wrong one, as well as the one rejected: the point
        is dropped, and begins anew with the track's next view.
        """
        seen = core.times_among(rejected, self.views.ids, self.views.used)
        young = rejected[(seen <= 1) & ~core.among(rejected, self.prior.ids)]
        self.rejections.add(rejected)
        self.views = changed(self.views, used=self.views.used & ~core.among(self.views.ids, young))
        self.select(~core.among(self.ids, young))
        self._dropped = core.union_of(np.concatenate([self._dropped, young]))

    def frames_agreed(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return in how many frames after their first one points `ids` (n,) agreed with the map.

        Those of the window, and as many again if a point is older than that.
        """
        count = core.times_among(ids, self.views.ids, self.views.used)
        return np.maximum(count + np.where(core.among(ids, self.prior.ids), len(self.frames), -1), 0)

    def consider_other(self, motion: Resection, std_moved: Array) -> None:
        """Add to the world's uncertainty that the second of two plausible motions may be the true one.

        No vehicle moves between two frames by much more than `std_moved` (6,) otherwise than it did.

        The difference of the two, in any direction, as the camera's motion may be that of a third set, which is hidden;
        and the error of the other, eq. (36a). The differences of frames in a row have one sign. Where what is followed
        may have been a body for some frames already, their motions may be wrong by as much.
        """
        other = motion.ambiguous
        if other is None:
            self._frames_ambiguous = 0
            return
        before, self._frames_ambiguous = self._frames_ambiguous, max(self._frames_ambiguous, other.lasted) + 1
        first_from_other = motion.cam_from_ref @ se3.inverse(other.cam_from_ref)  # of the newest camera
        apart = np.linalg.norm(se3.log(first_from_other).reshape(2, 3), axis=1)
        apart = np.minimum(apart, std_moved[[0, 3]])
        cov = Cholesky(Cholesky(other.cov_pose).inverse() + np.diag(std_moved**-2.0)).inverse()
        own = se3.adjoint(first_from_other) @ scaled_cholesky(cov)
        ambiguity = np.concatenate([np.diag(np.repeat(apart, 3)), own], axis=1)
        for frame in self.frames[-1 - other.lasted :]:
            if frame is self.frames[-1] or not frame.ambiguity.shape[1]:
                frame.ambiguity = ambiguity
        modes = se3.adjoint(se3.inverse(self.newest_cam_from_ref)) @ ambiguity
        modes[:, :6] *= np.sqrt(self._frames_ambiguous**2 - before**2)  # n frames of one sign: n²
        modes[:, 6:] *= self._frames_ambiguous - before  # so much is known of the camera's motion in all of these
        self._cov_doubt = self._cov_doubt + modes @ modes.T

    def settle(self) -> None:
        """Drop the uncertainty about alternative motions: those followed have turned out to be the camera's."""
        self._cov_doubt = np.zeros((6, 6))
        for frame in self.frames:
            frame.ambiguity = np.zeros((6, 0))

    @property
    def cov_doubt(self) -> Array:
        """What alternative motions, and patches that slide alike, add to the covariance (6, 6) of the newest pose."""
        ad = se3.adjoint(self.newest_cam_from_ref)
        return np.asarray(ad @ (self._cov_doubt + self._cov_slides) @ ad.T)

    def drop_undetermined(self) -> None:
        """Drop points that neither the prior nor an accepted stereo view of the window determines.

        Those that ended after a single view go too: it says nothing about anything else.
        """
        views = self.views
        keep = core.times_among(self.ids, views.ids, views.used & views.stereo) > 0
        keep &= (core.times_among(self.ids, views.ids, views.used) > 1) | core.among(
            self.ids, views.ids[self.newest]
        )
        keep |= core.among(self.ids, self.prior.ids)
        if not keep.all():
            self.select(keep)
            self.views = changed(views, used=views.used & core.among(views.ids, self.ids))

    def gauss_newton_step(self) -> float:
        """Move poses, points and modes by one step, and return the decrease of the sum of squares that it promised."""
        blocks = linearise(self.projection, self.state(), self.views)
        known = np.searchsorted(self.ids, self.prior.ids)
        inertial = None
        if self.inertia is not None and self.frames:
            inertial = self.inertia.linearise(self.cams_from_ref, self.inertial_state)
        self.system = System(self.prior, known, blocks, self.q, self.amplitudes, inertial)
        *change, decrease = self.system.step()
        self._move(*change)
        return decrease

    def gate(self, probability: float) -> None:
        """Take the views that the joint minimum contradicts out of use, each by its own covariance."""
        gates = chi2_gate(2, probability), chi2_gate(4, probability)
        used = core.views_within_gates(self.projection.pinholes, self.state(), self.views.of_core, *gates)
        self.rejections.add(self.views.ids[self.views.used & ~used])
        self.views = changed(self.views, used=used)

    def follow(self, system: System) -> None:
        """Move to the minimum of a system with the rig's errors as they are, and keep it."""
        dx, down, dq, dy, _ = system.step()
        self._move(dx, down, dq, np.concatenate([dy, np.zeros(len(self.prior.rig))]))
        self.system = system

    def _move(self, dx: Array, down: Array, dq: Array, dy: Array) -> None:
        """Move poses (F, 6), their own (F, e), points (P, 3) and amplitudes (k,)."""
        if self.inertia is not None and self.frames:
            self.inertia.follow(dx, self.prior.world_modes[6:] @ dy)
        self.cams_from_ref = se3.orthonormalise(se3.exp(dx) @ self.cams_from_ref)
        self.own, self.q, self.amplitudes = self.own + down, self.q + dq, self.amplitudes + dy

    def expect(
        self,
        frame: WindowFrame,
        views: WhitenedViews,
        rows: NDArray[np.intp],
        points: Array,
        cam_from_previous: Array,
        std_acceleration: Array,
    ) -> tuple[WhitenedViews, Array | None]:
        """Take what errors of the rig do to `rows` of the views of a frame to come, as they move there.

        Homogeneous points (n, 4) of the camera before, and roughly the motion (4, 4) since. Returns the views, and what
        they err by in common: by what is not known of the timing, with accelerations of σ (6,), by what is the frame's
        own, and by what is not known of the disparity: (n, 4, j) px of σ = 1; None for an exact rig.
        """
        if frame.rig is None:
            return views, None
        poses = [np.eye(4), *self.cams_from_ref, cam_from_previous @ self.newest_cam_from_ref]
        stamps_ns = [f.stamp_ns for f in (self.reference, *self.frames, frame)]
        self._seconds = self._clock.seconds(np.array(poses), stamps_ns, std_acceleration)
        motions = _as_turning(core.point_motions(np.array(poses), self._seconds), (*self.frames, frame))
        *_, before, now = motions
        moved = clamp_depth(points @ cam_from_previous.T)
        by_timing = np.zeros_like(views.timing)
        timing = self._timing(frame.rig)
        by_timing[rows] = frame.rig.by_timing(moved, now, timing[0], views.expected_px[rows])
        views = changed(views, timing=by_timing)
        of_twist = std_acceleration * (self._seconds[-1] - self._seconds[-2])
        delay_s, std_s = timing[0][0], np.sqrt(timing[1][0, 0])
        if self.has_twist or abs(delay_s) > PROBABLE * std_s:
            self._begin_twist()
            in_cam = core.seen_points(self.projection.pinholes, views.z_px)
            in_cam[rows] = moved
            in_cam[~np.isfinite(in_cam).all(axis=1)] = FAR  # the left side alone, which is not late
            cov_twist = self._twist_error.cov(std_acceleration, self._seconds)
            cov_twist = cov_twist + np.diag((_LEAST_TWIST * of_twist) ** 2)
            size_s = np.copysign(np.hypot(delay_s, std_s), delay_s)
            own = twist_columns(self.projection.pinholes, views, in_cam, size_s, cov_twist)
            views = changed(views, own=np.concatenate([views.own, own], axis=2))
        of_timing = core.timing_unknowns(
            *frame.rig.cameras, (points, before[0]), (moved, now[0]), *timing, of_twist
        )
        held = self.prior.rig.cov_held[DISPARITY, DISPARITY] + LEAST_VARIANCE * np.eye(DISPARITY.stop)
        of_disparity = frame.rig.by_disparity(points, cam_from_previous, views.z_px[rows]) @ np.linalg.cholesky(
            held
        )
        return views, np.concatenate([of_timing, views.own[rows], of_disparity], axis=2)

    def _begin_twist(self) -> None:
        """Make room for the error of the twist among the unknowns of each frame; that of the frames before is known."""
        if not self.has_twist:
            self.has_twist = True
            self.own = np.concatenate([self.own, np.zeros((len(self.own), TWIST))], axis=1)
            self.views = changed(self.views, own=with_room(self.views.own))
            if self._first is not None:
                self._first = changed(self._first, own=with_room(self._first.own))
                at = 6 + self.own.shape[1] - TWIST
                self.prior = self.prior.with_own_of_first(at, TWIST)
                self.amplitudes = np.insert(self.amplitudes, [at] * TWIST, 0.0)
        rows, own = self.newest, self.views.own.copy()
        own[rows, :, -TWIST:] = left_in_rows(own[rows, :, -TWIST:])
        self.views = changed(self.views, own=own)

    def renew_timing(self) -> None:
        """Take what delay and readout do to the used views of the window, with the velocities that are known now.

        They depend on the camera's velocity, which later frames tell better. The place is kept where a view was
        expected before it counted: at a place that goes along with the view's own noise, errors that hardly show would
        be estimated wrongly by a fixed amount, which is not averaged out.
        """
        rig = self.frames[-1].rig
        if rig is None:
            return
        motions = core.point_motions(np.array([np.eye(4), *self.cams_from_ref]), self._seconds)
        self._motions = _as_turning(motions, self.frames)
        if self._first is not None:
            self._renew_first(self._first, rig)
        self.views = timed(self.state(), self.views, rig, self._motions[1:], self._timing(rig)[0])

    @property
    def is_timed(self) -> bool:
        """Whether delay or readout are certain to be there, so that velocities matter to the poses."""
        rig = self.frames[-1].rig
        if rig is None:
            return False
        mean, cov = self._timing(rig)
        return bool((mean**2 > CERTAIN**2 * np.diag(cov)).any())

    def _timing(self, rig: RigModel) -> tuple[Array, Array]:
        """Return delay and readout (2,) as they are held, seconds, and their covariance (2, 2)."""
        return rig.timing(self.prior.rig.held, self.prior.rig.cov_held)

    def cov_of_timing(self, std_acceleration: Array) -> Array:
        """Return the covariance (6, 6) of the newest pose by its velocity, which delay and readout turn into errors."""
        rig, newest = self.frames[-1].rig, self.views[self.newest]
        if rig is None or not newest.used.any():
            return np.zeros((6, 6))
        indices = [f.index for f in (self.reference, *self.frames)]
        self._twist_error.add(indices, self._motions[:, 0])
        mean, cov = self._timing(rig)
        if self.has_twist:  # what it does by a delay is in the joint covariance
            mean, cov = mean * [0.0, 1.0], cov * np.outer([0.0, 1.0], [0.0, 1.0])
        in_cam = core.points_of_views(self.state(), newest.of_core)
        cov_twist = self._twist_error.cov(std_acceleration, self._seconds)
        return core.cov_of_timed_pose(*rig.cameras, in_cam, np.sqrt(mean**2 + np.diag(cov)), cov_twist)

    def _renew_first(self, views: WhitenedViews, rig: RigModel) -> None:
        """Begin the prior again with the first frame's views as they moved, which later frames tell better.

        Possible as long as nothing else is in the prior.
        """
        at, rig_error = np.searchsorted(self.ids, self.prior.ids), self.rig_error
        state = self._state_of_one(self.prior.ids, self.ref_from_anchor[at], self.q[at], rig_error)
        views = changed(views, used=core.among(views.ids, state.ids))
        views = at_rest(expected(state, views, rig), rig, self.prior.rig.age_s(self.reference.stamp_ns))
        self._first = views = timed(state, views, rig, self._motions[:1], self._timing(rig)[0])
        ages_s = np.array([self.prior.rig.age_s(f.stamp_ns) for f in self.frames])
        self.views = at_rest(held(self.views, views.ids, views.expected_px), rig, ages_s[self.views.frame])
        estimates = self._seen_alone(self._first, state, self.prior.rig.mean - rig_error)
        self.prior = self.prior.with_first_views(*estimates)

    def judge_rig(self) -> RigEstimate | None:
        """Return what the latest system says about the rig's errors, which are held there; None for an exact rig."""
        if not len(self.prior.rig):
            return None
        rig, model = self.prior.rig, self.frames[-1].rig
        mean, cov, information = self.system.rig_errors()
        changes = not rig.steady or (model is not None and model.focus_moves(mean, cov))
        counted = (mean, cov) if changes else rig.tempered(mean, cov, information)
        rig, found = rig.contradicted(mean, cov).judged(*counted)
        self._move(*self.system.follow_rig(rig.held - self.rig_error))
        self.prior = changed(self.prior, rig=rig)
        self.system.cov_rig = found.cov
        age = self.prior.rig.age_s(self.frames[-1].stamp_ns)
        evidence = rig.parts.evidence
        return RigEstimate(found.mean, found.cov, found.p_wrong, mean, cov, rig.size, age_s=age, evidence=evidence)

    @property
    def root_of_refocusing(self) -> Array | None:
        """A root (m, j) of the covariance by which the rig has changed, if windows contradict what is known of it.

        What moves all of a lens's errors at once and goes on moving is its focus, eq. (72g); None where nothing does.
        """
        rig, model = self.prior.rig, self.frames[-1].rig if self.frames else None
        if model is None or not rig.is_contradicted or self._frames_ambiguous or self._cov_doubt.any():
            return None
        root = model.root_of_unknown_focus(len(rig), rig.age_s(self.frames[-1].stamp_ns))
        return np.concatenate([root, np.diag(rig.size)], axis=1) if rig.steady else root

    def learn_rig(self, estimate: RigEstimate, field_std_px: float, by_rows: tuple[Array, Array]) -> None:
        """Give the prior of the rig's errors the sizes that their estimate makes likely, and what the rows said.

        `by_rows`: information (m,) and weighted sums (m,).
        """
        rig, (more, weighted) = self.prior.rig, by_rows
        if rig.steady:
            size = rig.likely_size(estimate.mean_if_wrong, estimate.cov_if_wrong, field_std_px)
            more = more + size**-2.0 - rig.size**-2.0
            rig = changed(rig, size=size)
        self.prior = changed(self.prior, rig=rig.informed(more, weighted))

    def begin_field(self, model: RigModel) -> None:
        """Add a field to the rig's errors, and what it does to the views of the window."""
        for frame in self.frames:
            frame.rig = model
        self.views = changed(self.views, field=model.field_at(self.views.expected_px))
        if self._first is not None:
            self._first = changed(self._first, field=model.field_at(self._first.z_px))
        n = len(model) - len(self.prior.rig)
        self.prior = self.prior.with_field(n)
        self.amplitudes = np.concatenate([self.amplitudes, np.zeros(n)])

    def change_rig(self, root: Array) -> None:
        """Record that the errors of the rig have changed since the newest frame by N(0, `root` rootᵀ), root (m, j).

        The window is empty by then: its frames were seen with the errors as they were.
        """
        self._first = None  # its views met the errors as they were
        self.prior = self.prior.with_rig_change(root)
        self.amplitudes = np.zeros(self.prior.modes.shape[2])

    def begin_inertia(self, window: InertialWindow, known: Known) -> None:
        """Add an inertial state, `known` in the newest camera, or begin it anew: that is the reference then."""
        while self.frames:
            self.absorb_oldest()
        rows = self.prior.world_modes[:6]
        self.prior = changed(self.prior, world_modes=rows, state=np.zeros(0)).with_state(known.state, known.cov)
        self.inertia = window
        self.amplitudes = np.zeros(self.prior.modes.shape[2])
        self.gauss_newton_step()

    def end_inertia(self) -> None:
        """Go on without inertia: what it has told of poses and points stays."""
        while self.frames:
            self.absorb_oldest()
        self.inertia = None
        self.prior = changed(self.prior, world_modes=self.prior.world_modes[:6], state=np.zeros(0))
        self.amplitudes = np.zeros(self.prior.modes.shape[2])
        self.gauss_newton_step()

    def place_newest(self, known: Known) -> Marginals:
        """Put the newest camera where images and inertia together have it; points keep their places in it."""
        before: Marginals = self.marginals
        pose, cov = known.world_from_cam, known.cov[:6, :6] + self.cov_doubt
        in_world = se3.transform(pose, before.points_in_cam)
        self.marginals = replace(before, world_from_cam=pose, cov_pose=cov, points_in_world=in_world)
        return self.marginals

    def true_poses(self) -> tuple[Array, Array, Array]:
        """Return the cameras of the window (F, 4, 4) where they are, a root (6F, n) of their covariance given the rig's
        errors, and how they move with these (6F, m): without the turns that patches feign, as far as inertia shows."""
        if self.inertia is None:
            poses = self.system.poses
            return self.cams_from_ref, self.system.root[:poses], self.system.by_rig[:poses]
        return self.inertia.true_cams(self.cams_from_ref), *self.inertia.true_poses(self.system)

    @property
    def cov_pose(self) -> Array:
        """The covariance (6, 6) of the newest pose in the world by the latest system."""
        own, rig = self.system.pose_and_world(len(self.frames) - 1)
        by_both = np.concatenate([-np.eye(6), se3.adjoint(self.newest_cam_from_ref)], axis=1)
        own, rig = by_both @ own, by_both @ rig
        return symmetric(own @ own.T + rig @ self.system.cov_rig @ rig.T) + self.cov_doubt

    def update_marginals(self) -> Marginals:
        """Compute the marginals of the newest frame from the latest system."""
        marginals = Marginals.compute(self.system, self.state(), self.world_from_ref)
        self.marginals = marginals.doubted(self.cov_doubt)
        return self.marginals


def _as_turning(motions: Array, frames: Sequence[WindowFrame]) -> Array:
    """Return motions (n, 2, 6) of points, those of the last frames turning as the gyroscope says, where there is one.

    A polynomial through poses cannot follow a camera that is shaken.
    """
    for motion, frame in zip(motions[len(motions) - len(frames) :], frames, strict=True):
        if frame.turning is not None:
            motion[:, 3:] = frame.turning
    return motions
