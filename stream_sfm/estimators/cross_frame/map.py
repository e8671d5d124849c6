"""The map of the window estimator: everything that exists only while the camera is being followed.

The reference camera p is the newest frame that has left the window; frames p+1 … n are in it with poses cam_from_ref.
Points are q in the cameras that first saw them (`inverse_depth`); the world is one more pose, carried by the prior.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import se3
from ...geometry.linear import matvec, scaled_cholesky
from ...geometry.resection import Resection
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection, clamp_depth
from ...record import rows_of
from ...rig_model.estimate import RigEstimate
from ...rig_model.model import RigEffects, RigModel
from ...rig_model.velocities import TimedViews, timing_unknowns, twists, velocities
from ...types import Solution
from ..ids import among, union
from .inverse_depth import WhitenedViews, homogeneous_from_q, in_reference, linearise, q_of_views
from .marginals import Marginals
from .normal_equations import System
from .outliers import RejectionCounts
from .prior import Prior
from .rig_knowledge import RigKnowledge
from .twist_error import TwistError
from .window_frame import WindowFrame

_TWIST_FRAMES = 5  # the newest ones, from which the velocity at the end is taken


class Map:
    """Points, poses and prior of one map, with their latest joint covariance.

    `ids` (P,) ascending, `q` (P, 3) and `ref_from_anchor` (P, 4, 4): every point; `begun_anew`: those that the
    newest frame began a second time, by one view. `frames`: the window, oldest first; the map has all of their views
    with the rig's effects, one after the other. `reference_index`: which frame the reference camera is. `prior`, and
    the `amplitudes` (k,) of its modes. `system`: the latest normal equations, factored. `marginals`: of the latest
    frame.
    """

    def __init__(
        self, projection: StereoProjection, frame: WindowFrame, first: Solution, rig: RigKnowledge
    ) -> None:
        """Begin a map in the camera of `frame`, which becomes the reference.

        `first` says which views start points; `rig`: what is known about the rig's errors.
        """
        self.projection = projection
        self.frames: list[WindowFrame] = []
        # used or not; points are counted anew when they are asked for
        self._all_views = WhitenedViews.none(len(rig))
        self._twist_error = TwistError()
        self._twists = np.zeros((1, 6))  # of the reference camera and of the window
        self._first: WindowFrame | None = frame  # until another one is absorbed
        self.reference_index, self.reference_ns = frame.index, frame.stamp_ns
        self.rejections = RejectionCounts()
        self.begun_anew = self._dropped = np.empty(0, np.int64)
        self._frames_ambiguous, self._cov_doubt = 0, np.zeros((6, 6))  # in axes of the reference camera
        self.ids = first.track_ids
        frame.used = among(frame.ids, self.ids)
        self.q = q_of_views(projection, frame.corrected_px(rig.mean)[frame.used])
        self.ref_from_anchor = np.broadcast_to(np.eye(4), (len(self.ids), 4, 4))
        views = frame.views(self.ids)
        blocks = linearise(projection, np.eye(4)[None], self.ref_from_anchor, self.q, rig.mean, views)
        self.q, cov, by_rig = blocks.points_alone(self.q, np.zeros(len(rig)))
        pose = first.world_from_cam, first.cov_pose
        self.prior = Prior.from_first_frame(self.ids, self.q, cov, by_rig, *pose, rig)
        self.amplitudes = np.zeros(self.prior.modes.shape[2])
        self.gauss_newton_step(WhitenedViews.none(len(rig)))
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
    def newest_cam_from_ref(self) -> Array:
        """The pose (4, 4) of the newest camera; that is the reference until a second frame has come."""
        return self.frames[-1].cam_from_ref if self.frames else np.eye(4)

    def cams_from_ref(self) -> Array:
        """Return the poses (F, 4, 4) of the window."""
        return np.array([f.cam_from_ref for f in self.frames]).reshape(-1, 4, 4)

    def views(self) -> WhitenedViews:
        """Return the used views of the window."""
        return self._all_views[self._used_rows()].of_map(self.ids)

    def _used_rows(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.concatenate([f.used for f in self.frames]))

    def remove_oldest(self) -> WindowFrame:
        """Take the oldest frame out of the window, with its views."""
        frame = self.frames.pop(0)
        n = len(frame.ids)
        frame.rig_effects = self._all_views.rig_effects[:n]
        later = self._all_views[n:]
        self._all_views = replace(later, frame=later.frame - 1)
        return frame

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> None:
        """Keep the points of a mask or of an order."""
        self.ids, self.q = rows_of(self.ids, rows), rows_of(self.q, rows)
        self.ref_from_anchor = rows_of(self.ref_from_anchor, rows)

    def enter(self, frame: WindowFrame, rejected: NDArray[np.int64], ambiguous: bool) -> None:
        """Add the newest frame to the window, without the views of `rejected` tracks.

        Points that the map does not hold yet start at their stereo view. Where the motion is `ambiguous`, the tracks
        may be right another time, and nothing is held against them.
        """
        if not ambiguous:
            self._count_rejected(rejected)
        excluded = self.rejections.excluded(frame.ids)
        known = among(frame.ids, self.ids)
        new = ~known & frame.stereo & ~excluded & ~among(frame.ids, rejected)
        again = among(self._dropped, frame.ids[new])
        self.begun_anew, self._dropped = self._dropped[again], self._dropped[~again]
        frame.used = (known & ~among(frame.ids, rejected) | new) & ~excluded
        ref_from_cam = se3.inverse(frame.cam_from_ref)
        self.ids = np.concatenate([self.ids, frame.ids[new]])
        self.q = np.concatenate([self.q, q_of_views(self.projection, frame.corrected_px(self.rig_error)[new])])
        self.ref_from_anchor = np.concatenate(
            [self.ref_from_anchor, np.broadcast_to(ref_from_cam, (int(new.sum()), 4, 4))]
        )
        self.select(np.argsort(self.ids))
        views = frame.all_views(len(self.frames))
        self._all_views = WhitenedViews.concatenate([self._all_views, views]) if self.frames else views
        self.frames.append(frame)

    def _count_rejected(self, rejected: NDArray[np.int64]) -> None:
        """Remember which tracks disagree with the motion.

        Of a track with one view in the map that one view may be the wrong one, as well as the one rejected: the point
        is dropped, and begins anew with the track's next view.
        """
        seen = np.array([among(rejected, f.ids[f.used]) for f in self.frames], int)
        young = (seen.sum(0) <= 1) & ~among(rejected, self.prior.ids)
        for track_id in rejected.tolist():
            self.rejections.add(track_id)
        for f in self.frames:
            f.used &= ~among(f.ids, rejected[young])
        self.select(~among(self.ids, rejected[young]))
        self._dropped = union(self._dropped, rejected[young])

    def frames_agreed(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return in how many frames after their first one points `ids` (n,) agreed with the map.

        Those of the window, and as many again if a point is older than that.
        """
        count = len(self.frames) * among(ids, self.prior.ids).astype(np.int64) - ~among(ids, self.prior.ids)
        for frame in self.frames:
            count += among(ids, frame.ids[frame.used])
        return np.maximum(count, 0)

    def consider_other(self, motion: Resection) -> None:
        """Add to the world's uncertainty that the second of two plausible motions may be the true one.

        The difference of the two, in any direction, as the camera's motion may be that of a third set, which is hidden;
        and the error of the other, eq. (36a). The differences of frames in a row have one sign.
        """
        other = motion.ambiguous
        if other is None:
            self._frames_ambiguous = 0
            return
        self._frames_ambiguous += 1
        first_from_other = motion.cam_from_ref @ se3.inverse(other.cam_from_ref)  # of the newest camera
        apart = np.linalg.norm(se3.log(first_from_other).reshape(2, 3), axis=1)
        own = se3.adjoint(first_from_other) @ scaled_cholesky(other.cov_pose)
        ambiguity = np.concatenate([np.diag(np.repeat(apart, 3)), own], axis=1)
        self.frames[-1].ambiguity = ambiguity
        modes = se3.adjoint(se3.inverse(self.newest_cam_from_ref)) @ ambiguity
        modes[:, :6] *= np.sqrt(2 * self._frames_ambiguous - 1)  # n frames of one sign: n² = 1 + 3 + 5 + …
        self._cov_doubt = self._cov_doubt + modes @ modes.T

    def settle(self) -> None:
        """Drop the uncertainty about alternative motions: those followed have turned out to be the camera's."""
        self._cov_doubt = np.zeros((6, 6))
        for frame in self.frames:
            frame.ambiguity = np.zeros((6, 0))

    @property
    def cov_doubt(self) -> Array:
        """The covariance (6, 6) that alternative motions, which may have been the camera's, add to the newest pose."""
        ad = se3.adjoint(self.newest_cam_from_ref)
        return np.asarray(ad @ self._cov_doubt @ ad.T)

    def move_reference(self, frame: WindowFrame) -> None:
        """Take a frame that leaves the window for the reference camera."""
        self._first = None  # its views stay in the prior as they are
        self.reference_index, self.reference_ns = frame.index, frame.stamp_ns
        ad = se3.adjoint(frame.cam_from_ref)
        self._cov_doubt = ad @ self._cov_doubt @ ad.T

    def drop_undetermined(self) -> None:
        """Drop points that neither the prior nor an accepted stereo view of the window determines.

        Those that ended after a single view go too: it says nothing about anything else.
        """
        at = np.concatenate([np.searchsorted(self.ids, f.ids[f.used]) for f in self.frames])
        stereo = np.concatenate([f.stereo[f.used] for f in self.frames])
        count = np.bincount(at, minlength=len(self.ids))
        keep = np.bincount(at[stereo], minlength=len(self.ids)) > 0
        keep &= (count > 1) | among(self.ids, self.frames[-1].ids)
        keep[np.searchsorted(self.ids, self.prior.ids)] = True
        if not keep.all():
            self.select(keep)
            for f in self.frames:
                f.used &= among(f.ids, self.ids)

    def gauss_newton_step(self, views: WhitenedViews) -> float:
        """Move poses, points and modes by one step, and return the decrease of the sum of squares that it promised."""
        cams = self.cams_from_ref()
        blocks = linearise(self.projection, cams, self.ref_from_anchor, self.q, self.rig_error, views)
        self.system = System(self.prior, np.searchsorted(self.ids, self.prior.ids), blocks)
        *change, decrease = self.system.step(blocks, self.q, self.amplitudes)
        self._move(*change)
        return decrease

    def _move(self, dx: Array, dq: Array, dy: Array) -> None:
        """Move poses (F, 6), points (P, 3) and amplitudes (k,)."""
        for f, cam in zip(self.frames, se3.orthonormalise(se3.exp(dx) @ self.cams_from_ref()), strict=True):
            f.cam_from_ref = cam
        self.q, self.amplitudes = self.q + dq, self.amplitudes + dy

    def expect(
        self,
        frame: WindowFrame,
        rows: NDArray[np.intp],
        points: Array,
        cam_from_previous: Array,
        std_acceleration: Array,
    ) -> Array | None:
        """Take what errors of the rig do to views `rows` of a frame to come, as they move there.

        Homogeneous points (n, 4) of the camera before, and roughly the motion (4, 4) since. Returns what is not known
        of the timing of the views, with accelerations of σ (6,): (n, 4, j) px of σ = 1; None where nothing is.
        """
        if frame.rig is None:
            return None
        poses = [np.eye(4), *(f.cam_from_ref for f in self.frames)]
        stamps = [*self._stamps_ns(), frame.stamp_ns]
        *_, before, now = twists(
            np.stack([*poses, cam_from_previous @ poses[-1]])[-_TWIST_FRAMES:], stamps[-_TWIST_FRAMES:]
        )
        moved = clamp_depth(points @ cam_from_previous.T)
        by_timing = frame.rig.by_timing(moved, now[None], frame.seen_px(rows))
        frame.rig_effects = frame.rig_effects.timed(rows, by_timing)
        then = TimedViews(self.projection, points, before, frame.rig.row_of)
        views = TimedViews(self.projection, moved, now, frame.rig.row_of)
        timing = frame.rig.timing(self.prior.rig.held, self.prior.rig.cov_held)
        return timing_unknowns(then, views, *timing, std_acceleration * (stamps[-1] - stamps[-2]) / 1e9)

    def renew_rig_effects(self) -> None:
        """Take what errors of the rig do to the used views of the window, with the velocities that are known now.

        What a delay or a readout does depends on the camera's velocity, which later frames tell better. The place is
        kept where a view was expected before it counted: at a place that goes along with the view's own noise, errors
        that hardly show would be estimated wrongly by a fixed amount, which is not averaged out.
        """
        rig = self.frames[-1].rig
        if rig is None:
            return
        cams = self.cams_from_ref()
        self._twists = twists(np.concatenate([np.eye(4)[None], cams]), self._stamps_ns())
        if self._first is not None:
            self._renew_first(self._first, rig, self._twists[0])
        views, rows = self.views(), self._used_rows()
        in_cam = core.window_points(cams, self.ref_from_anchor, self.q, views.frame, views.point)
        newest, at = self.frames[-1], views.frame == len(self.frames) - 1
        stereo = newest.stereo[newest.used]
        newest.expected_px[newest.used] = self._expected_px(in_cam[at], stereo, views.rig_effects[at])
        at_rest = rig.effects_by_parts(newest.expected_px[newest.used], age_s=self.prior.rig.age_s(newest.stamp_ns))
        effects = self._all_views.rig_effects.take(rows[at], at_rest)
        by_timing = rig.by_timing(in_cam, self._twists[1:][views.frame], self._everywhere_expected_px()[rows])
        self._all_views = replace(self._all_views, rig_effects=effects.timed(rows, by_timing))

    def _everywhere_expected_px(self) -> Array:
        """Return where all views of the window were expected (V, 4)."""
        return np.concatenate([np.empty((0, 4)), *(f.expected_px for f in self.frames)])

    def _expected_px(self, in_cam: Array, stereo: NDArray[np.bool_], effects: RigEffects) -> Array:
        """Return where views of homogeneous points (n, 4) are expected (n, 4); `stereo` (n,): both sides were seen."""
        z_px = self.projection.project_homogeneous(in_cam) + effects.at(self.rig_error)
        z_px[~stereo, 2:] = np.nan
        return z_px

    def _stamps_ns(self) -> list[int]:
        """Return the stamps of the reference camera and of the window."""
        return [self.reference_ns, *(f.stamp_ns for f in self.frames)]

    def cov_of_timing(self, std_acceleration: Array) -> Array:
        """Return the covariance (6, 6) of the newest pose by its velocity, which delay and readout turn into errors."""
        newest = self.frames[-1]
        if newest.rig is None or not newest.used.any():
            return np.zeros((6, 6))
        self._twist_error.add([self.reference_index, *(f.index for f in self.frames)], self._twists)
        mean, cov = newest.rig.timing(self.prior.rig.held, self.prior.rig.cov_held)
        at = np.searchsorted(self.ids, newest.ids[newest.used])
        in_cam = clamp_depth(matvec(newest.cam_from_ref, in_reference(self.ref_from_anchor[at], self.q[at])))
        views = TimedViews(self.projection, in_cam, np.zeros(6), newest.rig.row_of)
        stamps = self._stamps_ns()
        cov_twist = self._twist_error.cov(std_acceleration, (stamps[-1] - stamps[-2]) / 1e9)
        size = np.sqrt(mean**2 + np.diag(cov))
        return views.cov_of_pose(size, cov_twist)

    def _renew_first(self, frame: WindowFrame, rig: RigModel, twist: Array) -> None:
        """Begin the prior again with the first frame's views as they moved, which later frames tell better.

        Possible as long as nothing else is in the prior.
        """
        at = np.searchsorted(self.ids, self.prior.ids)
        frame.used = among(frame.ids, self.prior.ids)
        q, anchors = self.q[at], self.ref_from_anchor[at]
        rows = np.flatnonzero(frame.used)
        age = self.prior.rig.age_s(frame.stamp_ns)
        in_cam = homogeneous_from_q(q)
        expected_px = self._expected_px(in_cam, frame.stereo[rows], frame.rig_effects[rows])
        effects = rig.effects_by_parts(expected_px, velocities(self.projection, in_cam, twist), age)
        frame.rig_effects = frame.rig_effects.take(rows, effects)
        views = frame.views(self.prior.ids)
        blocks = linearise(self.projection, np.eye(4)[None], anchors, q, self.rig_error, views)
        estimates = blocks.points_alone(q, self.prior.rig.mean - self.rig_error)
        self.prior = self.prior.with_first_views(*estimates)

    def judge_rig(self, misfit: bool) -> RigEstimate | None:
        """Return what the latest system says about the rig's errors, which are held there; None for an exact rig.

        `misfit`: as in `Observations`.
        """
        if not len(self.prior.rig):
            return None
        rig, model = self.prior.rig, self.frames[-1].rig
        mean, cov, information = self.system.rig_errors()
        changes = not rig.steady or (model is not None and model.focus_moves(mean, cov))
        counted = (mean, cov) if changes else rig.tempered(mean, cov, information)
        rig, found = rig.judged(*counted, misfit)
        self._move(*self.system.follow_rig(rig.held - self.rig_error))
        self.prior = replace(self.prior, rig=rig)
        self.system.count_rig_errors(found.cov)
        age = self.prior.rig.age_s(self.frames[-1].stamp_ns)
        return RigEstimate(found.mean, found.cov, found.p_wrong, mean, cov, rig.size, age_s=age)

    def learn_rig(self, estimate: RigEstimate, field_std_px: float, by_rows: tuple[Array, Array]) -> None:
        """Give the prior of the rig's errors the sizes that their estimate makes likely, and what the rows said.

        `by_rows`: information (m,) and weighted sums (m,).
        """
        rig, (more, weighted) = self.prior.rig, by_rows
        if rig.steady:
            size = rig.likely_size(estimate.mean_if_wrong, estimate.cov_if_wrong, field_std_px)
            more = more + size**-2.0 - rig.size**-2.0
            rig = replace(rig, size=size)
        self.prior = replace(self.prior, rig=rig.informed(more, weighted))

    def begin_field(self, model: RigModel) -> None:
        """Add a field to the rig's errors, and what it does to the views of the window."""
        for frame in self.frames:
            frame.rig = model
        effects = RigEffects(self._all_views.rig_effects.terms, model.field_at(self._everywhere_expected_px()))
        self._all_views = replace(self._all_views, rig_effects=effects)
        if self._first is not None:
            self._first.rig = model
            self._first.rig_effects = RigEffects(self._first.rig_effects.terms, model.field_at(self._first.z_px))
        n = len(model) - len(self.prior.rig)
        self.prior = self.prior.with_field(n)
        self.amplitudes = np.concatenate([self.amplitudes, np.zeros(n)])

    def change_rig(self, root: Array) -> None:
        """Record that the errors of the rig have changed since the newest frame by N(0, `root` rootᵀ), root (m, j).

        The window is empty by then: its frames were seen with the errors as they were.
        """
        self.prior = self.prior.with_rig_change(root)
        self.amplitudes = np.zeros(self.prior.modes.shape[2])

    def update_marginals(self) -> Marginals:
        """Compute the marginals of the newest frame from the latest system."""
        marginals = Marginals.compute(
            self.system,
            self.ids,
            self.ref_from_anchor,
            self.q,
            self.world_from_ref,
            self.newest_cam_from_ref,
            len(self.frames) - 1,
        )
        self.marginals = marginals.doubted(self.cov_doubt) if self._cov_doubt.any() else marginals
        return self.marginals
