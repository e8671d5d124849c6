"""The map of the window estimator: everything that exists only while the camera is being followed.

The reference camera p is the newest frame that has left the window; frames p+1 … n are in it with poses cam_from_ref.
Points are q in the cameras that first saw them (`inverse_depth`); the world is one more pose, carried by the prior.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...geometry import se3
from ...geometry.linear import matvec, scaled_cholesky, symmetric_inverse
from ...geometry.resection import Resection
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection, clamp_depth
from ...types import RigEstimate, Solution
from ..ids import among, union
from .inverse_depth import WhitenedViews, in_reference, linearise, q_of_views, whitened_residuals
from .marginals import Marginals
from .normal_equations import System
from .outliers import RejectionCounts
from .prior import Prior
from .rig_knowledge import RigKnowledge, followed_by_most
from .window_frame import WindowFrame


class Map:
    """Points, poses and prior of one map, with their latest joint covariance.

    `ids` (P,) ascending, `q` (P, 3) and `ref_from_anchor` (P, 4, 4): every point; `begun_anew`: those that the
    newest frame began a second time, by one view. `frames`: the window, oldest first;
    `reference_index`: which frame the reference camera is. `prior`, and the `amplitudes` (k,) of its modes. `system`:
    the latest normal equations, factored. `marginals`: of the latest frame.
    """

    def __init__(
        self, projection: StereoProjection, frame: WindowFrame, first: Solution, rig: RigKnowledge
    ) -> None:
        """Begin a map in the camera of `frame`, which becomes the reference.

        `first` says which views start points; `rig`: what is known about the rig's errors.
        """
        self.projection = projection
        self.frames: list[WindowFrame] = []
        self.reference_index = frame.index
        self.rejections = RejectionCounts()
        self.begun_anew = self._dropped = np.empty(0, np.int64)
        self._frames_in_doubt = 0
        self.ids = first.track_ids
        frame.used = among(frame.ids, self.ids)
        self.q = q_of_views(projection, frame.corrected_px(rig.mean)[frame.used])
        self.ref_from_anchor = np.broadcast_to(np.eye(4), (len(self.ids), 4, 4))
        views = frame.views(self.ids, 0)
        blocks = linearise(projection, np.eye(4)[None], self.ref_from_anchor, self.q, rig.mean, views)
        cov = symmetric_inverse(blocks.v)
        self.q = self.q + matvec(cov, blocks.g_point)
        by_rig = -cov @ blocks.rig_point
        self.prior = Prior.from_first_frame(
            self.ids, self.q, cov, by_rig, first.world_from_cam, first.cov_pose, rig
        )
        self.amplitudes = np.zeros(self.prior.modes.shape[2])
        self.gauss_newton_step(WhitenedViews.none(len(rig)))
        self.marginals = self._marginals()

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
        return np.stack([f.cam_from_ref for f in self.frames]) if self.frames else np.empty((0, 4, 4))

    def views(self) -> WhitenedViews:
        """Return the used views of the window."""
        return WhitenedViews.concatenate([f.views(self.ids, row) for row, f in enumerate(self.frames)])

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> None:
        """Keep the points of a mask or of an order."""
        self.ids, self.q, self.ref_from_anchor = self.ids[rows], self.q[rows], self.ref_from_anchor[rows]

    def enter(self, frame: WindowFrame, rejected: NDArray[np.int64], contested: bool) -> None:
        """Add the newest frame to the window, without the views of `rejected` tracks.

        Points that the map does not hold yet start at their stereo view. Where the motion is `contested`, the tracks
        may be right another time, and nothing is held against them.
        """
        if not contested:
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

    def doubt(self, motion: Resection) -> None:
        """Take into the world's uncertainty that the newest motion may be the other of two that the views agree with.

        Modes of the world with the difference of the two, in any direction, as the camera's motion may be that of a
        third set, which is hidden; and with the error of the other, eq. (36a). The differences of frames in a row have
        one sign.
        """
        rival = motion.rival
        if rival is None:
            self._frames_in_doubt = 0
            return
        self._frames_in_doubt += 1
        first_from_other = motion.cam_from_ref @ se3.inverse(rival.cam_from_ref)  # of the newest camera
        apart = np.linalg.norm(se3.log(first_from_other).reshape(2, 3), axis=1)
        own = se3.adjoint(first_from_other) @ scaled_cholesky(rival.cov_pose)
        doubt = np.concatenate([np.diag(np.repeat(apart, 3)), own], axis=1)
        self.frames[-1].doubt = doubt
        modes = se3.adjoint(se3.inverse(self.newest_cam_from_ref)) @ doubt
        modes[:, :6] *= np.sqrt(2 * self._frames_in_doubt - 1)  # n frames of one sign: n² = 1 + 3 + 5 + …
        self.prior = self.prior.with_world_modes(modes)
        self.amplitudes = np.concatenate([np.zeros(modes.shape[1]), self.amplitudes])

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
        dx, dq, dy, decrease = self.system.step(blocks, self.q, self.amplitudes)
        for f, cam in zip(self.frames, se3.orthonormalise(se3.exp(dx) @ cams), strict=True):
            f.cam_from_ref = cam
        self.q, self.amplitudes = self.q + dq, self.amplitudes + dy
        return decrease

    def refine_rig_effects(self, frame: WindowFrame) -> None:
        """Take what errors of the rig do to the used views of a frame where the present estimate expects them."""
        at = np.searchsorted(self.ids, frame.ids[frame.used])
        in_cam = matvec(frame.cam_from_ref, in_reference(self.ref_from_anchor[at], self.q[at]))
        expected_px = self.projection.project_homogeneous(clamp_depth(in_cam))
        frame.refine_rig_effects(expected_px + frame.rig_effects[frame.used] @ self.rig_error)

    def rig_estimate(self) -> RigEstimate | None:
        """Return what the latest system says about the rig's errors; None where none are possible."""
        rig, root = self.prior.rig, self.system.chol.root[self.system.rig, self.system.rig]
        if not len(rig):
            return None
        root = rig.root @ root
        mean = self.rig_error + root @ self.system.rig_offset
        return RigEstimate(mean, root @ root.T, rig.estimated, np.full(len(rig), rig.size))

    def judge_rig(self) -> None:
        """Let the rig's errors be estimated from now on if they have become significant, and most tracks follow."""
        self.prior = replace(self.prior, rig=self.prior.rig.judge(self.system.rig_offset, self._rig_followed))

    def _rig_followed(self) -> float:
        """Return how far most tracks go with the step to the estimate of the rig's errors, eq. (72c)."""
        views = self.views()
        cams, anchors, rig_error = self.cams_from_ref(), self.ref_from_anchor, self.rig_error
        dx, dq, dc = self.system.step_of_rig()
        _, held = whitened_residuals(self.projection, cams, anchors, self.q, rig_error, views)
        cams, q, rig_error = se3.exp(dx) @ cams, self.q + dq, rig_error + dc
        _, left = whitened_residuals(self.projection, cams, anchors, q, rig_error, views)
        return followed_by_most(views.point, held, held - left)

    def resize_rig(self, estimate: RigEstimate | None) -> None:
        """Let the prior of the rig's errors have from now on the size that its `rig_estimate` makes likely."""
        rig = self.prior.rig
        if estimate is None or rig.of_disparity is None:
            return
        self.prior, u = self.prior.with_rig_size(rig.likely_size(estimate))
        own, of_rig = np.split(self.amplitudes, [len(self.amplitudes) - len(rig)])
        self.amplitudes = np.concatenate([own, np.linalg.solve(u, of_rig)])

    def change_rig(self, root: Array) -> None:
        """Take in that the errors of the rig have changed since the newest frame by N(0, `root` rootᵀ), root (m, j).

        The window is empty by then: its frames were seen with the errors as they were.
        """
        self.prior = self.prior.with_rig_change(root)
        self.amplitudes = np.zeros(self.prior.modes.shape[2])

    def update_marginals(self) -> Marginals:
        """Compute the marginals of the newest frame from the latest system."""
        self.marginals = self._marginals()
        return self.marginals

    def _marginals(self) -> Marginals:
        return Marginals.compute(
            self.system,
            self.ids,
            self.ref_from_anchor,
            self.q,
            self.world_from_ref,
            self.newest_cam_from_ref,
            len(self.frames) - 1,
        )
