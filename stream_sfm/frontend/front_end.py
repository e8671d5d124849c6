"""The front-end of a pair: rectified images in, observations out.

Each frame: follow the points (`tracker.py`), add new ones where they are missing (`new_points.py`), check the images
(`image_checks.py`). A frame in which nothing can be followed and nothing new be found is skipped, and so is one in
which the background is hidden: the next ones are followed from the last good frame, for a second.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..camera.refinement import Refinement
from ..config import Config
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import RigModel
from ..types import Observations, RigChange
from .alignment import TemplateAligners
from .depth_source import StereoDepth
from .image_checks import image_note
from .new_points import NewPoints, renews
from .pair_check import PairCheck, PairFit
from .persistence import Persistence
from .prepared import Image, PreparedImages
from .right_turn import TurnWatch, rig_change, root_of_turn, shift_of_turn, with_turn
from .timing import Timing
from .tracker import Followed, Tracker

_HIDDEN = "the background is hidden: what can be followed has moved by itself"


class StereoFrontEnd:
    """Follows points through rectified pairs.

    `valid` (h, w): pixels of the left image that hold picture. `refinement`: errors of the calibration that are known,
    which the observations do not have any more. `row_of`: as in `RigModel`.
    """

    def __init__(
        self,
        projection: StereoProjection,
        config: Config,
        valid: NDArray[np.bool_],
        refinement: Refinement | None = None,
        row_of: Callable[[Array], Array] | None = None,
    ) -> None:
        self.config = config.frontend
        self._min_points = config.robust.min_inliers
        self._gate_probability = config.robust.gate_probability
        self.aligners = TemplateAligners(self.config, valid)
        self.depth = depth = StereoDepth(projection, config, self.aligners)
        self.turn_watch = None if config.rig.exact else TurnWatch(projection)
        timing = Timing.unknown(projection, config.rig, row_of)
        self.tracker = Tracker(projection, config, self.aligners, depth, timing, self.turn_watch)
        self.new_points = NewPoints(self.tracker, self.aligners, depth)
        self.pair_check = PairCheck(projection, depth, self.aligners.fine.noise)
        self.persistence = Persistence(config.estimate_every)
        self.rig = RigModel.of(projection, config.rig, refinement, row_of)
        self._exact = config.rig.exact

    def prepare(self, left: Image, right: Image, frame_index: int | None = None) -> PreparedImages:
        """Compute from rectified images (h, w) uint8 the forms that `step` needs.

        Pure: any thread may call it at any time, in any order, also for frames that are never stepped. With the
        `frame_index` that the frame is going to have, its corners are computed here too and not in `step`; the
        observations are the same.
        """
        images = PreparedImages.of(left, right, self.config.smoothing_px)
        if frame_index is not None and renews(frame_index):
            _ = images.corner_strength  # computed now, kept for `step`
        return images

    def step(self, frame_index: int, stamp_ns: int, images: PreparedImages) -> Observations:
        """Observations of the next frame; indices count the frames from 0, stamps ascend."""
        change = self._take_out_turn(frame_index)
        observed = self._step(frame_index, stamp_ns, images)
        if change is None:
            return observed
        return replace(observed, rig_change=change, rig_change_root=root_of_turn(self.rig))

    def _take_out_turn(self, frame_index: int) -> RigChange | None:
        """Take a turn of the right camera that the frames before have shown out of all that is measured from now on."""
        watch = self.turn_watch
        rad = None if watch is None else watch.lasting_rad
        if watch is None or rad is None:
            return None
        first = frame_index - watch.suspected_frames
        watch.forget()
        self.depth.turn.add(rad)
        return rig_change(self.tracker.projection, first, rad)

    def _step(self, frame_index: int, stamp_ns: int, images: PreparedImages) -> Observations:
        """Observations of the next frame, with the right camera as it is known to stand."""
        tracker = self.tracker
        followed = tracker.follow(images, stamp_ns)
        fit = self._fit(followed)
        start_anew = self.pair_check.judge(images, tracker.previous, fit, tracker.next_id)
        if followed is None or start_anew:
            return self._start_over(frame_index, stamp_ns, images, wait=not start_anew)
        drift_px = self.aligners.drift(tracker.tracks, followed.cam_from_previous)
        z_new, cov_new = self._new_views(images, frame_index)
        z_px = np.concatenate([followed.z_px, z_new])
        cov_px = np.concatenate([followed.cov_px, cov_new])
        observed = self._observed(frame_index, stamp_ns, z_px, cov_px, self._note(images, z_px))
        tracker.remember(images, stamp_ns)
        return replace(
            observed,
            cam_from_previous=followed.cam_from_previous,
            rival_from_previous=None if followed.rival is None else followed.rival.cam_from_ref,
            cov_rival=None if followed.rival is None else followed.rival.cov_pose,
            n_new=len(z_new),
            std_drift_px=np.concatenate([drift_px, np.zeros(len(z_new))]),
        )

    def _new_views(self, images: PreparedImages, frame_index: int) -> tuple[Array, Array]:
        """Views (k, 4) of new points and their covariances; none while depths cannot be measured."""
        if self.turn_watch is not None and self.turn_watch.suspected_frames:
            return np.empty((0, 4)), np.empty((0, 4, 4))
        return self.new_points.add(images, frame_index)

    def _fit(self, followed: Followed | None) -> PairFit | None:
        """How left and right fit each other, where tracks were followed."""
        if followed is None or followed.found is None:
            return None
        return PairFit.of(followed.found, self.tracker.projection, self._gate_probability)

    def _start_over(
        self, frame_index: int, stamp_ns: int, images: PreparedImages, wait: bool = True
    ) -> Observations:
        """Observations of a frame that could not be followed: new points only, or none, and then it is skipped.

        Where nothing is to `wait` for, the tracks are dropped at once.
        """
        tracker = self.tracker
        waits, nothing = wait and tracker.may_wait(stamp_ns), (np.empty((0, 4)), np.empty((0, 4, 4)))
        if waits and tracker.background_hidden:
            return self._observed(frame_index, stamp_ns, *nothing, _HIDDEN)
        before = tracker.tracks, tracker.velocity
        tracker.lose()
        z_px, cov_px = self.new_points.add(images, frame_index)
        note = self._note(images, z_px)
        if waits and len(z_px) < self._min_points:
            tracker.tracks, tracker.velocity = before
            return self._observed(frame_index, stamp_ns, *nothing, note)
        tracker.remember(images, stamp_ns)
        return replace(self._observed(frame_index, stamp_ns, z_px, cov_px, note), n_new=len(z_px))

    def _observed(self, frame_index: int, stamp_ns: int, z_px: Array, cov_px: Array, note: str) -> Observations:
        """Observations of all tracks, views (n, 4) with covariances (n, 4, 4), or of none."""
        ids = self.tracker.tracks.ids[: len(z_px)]
        return Observations(
            frame_index=frame_index,
            stamp_ns=stamp_ns,
            track_ids=ids,
            z_px=self.rig.corrected(z_px),
            cov_px=cov_px,
            note=self._turn_note() or note or self.pair_check.doubt,
            doubtful=bool(self.pair_check.doubt),
            std_drift_px=np.zeros(len(z_px)),
            rig=None if self._exact else self.rig,
            field_std_px=self.depth.rows.field_std_px,
            inflation=self.persistence.inflation(ids, z_px, cov_px),
            timing_px=self._timing_px(len(z_px)),
        )

    def _timing_px(self, n: int) -> Array:
        """What delay and readout do, as far as they are known, to the views of the first n tracks: (n, 4) px."""
        points, timing = self.tracker.tracks.points[:n], self.tracker.timing
        return np.zeros((n, 4)) if timing.twist is None else timing.taken_out(points, timing.twist)

    def _turn_note(self) -> str:
        """Say that the right camera seems to have turned."""
        watch = self.turn_watch
        if watch is None or not watch.suspected_frames:
            return ""
        shift_px = shift_of_turn(self.tracker.projection, watch.latest_rad)
        return (
            f"the right image has moved against the left one, by {shift_px:.2f} px: estimated from the left image "
            "until it is clear whether the cameras have moved"
        )

    def _note(self, images: PreparedImages, z_px: Array) -> str:
        """What is wrong with the images, from the views (n, 4) of all tracks."""
        n_in_both = int(np.isfinite(z_px).all(axis=1).sum())
        return image_note(images, self.tracker.previous, len(z_px), n_in_both)

    def learn(self, estimate: RigEstimate) -> None:
        """Take in what an estimator has found out about the rig with the latest frame, in units of σ."""
        self.tracker.learn(*self.rig.timing(estimate.mean, estimate.cov))

    def std_bias_px(self, ids: NDArray[np.int64]) -> Array:
        """σ (n,) of the disparity error that all views of a point share, px, of points by id (n,)."""
        return self.new_points.bias.std_px(ids)

    def rig_in_px(self, estimate: RigEstimate | None) -> RigEstimate | None:
        """Errors of the calibration in units of their σ, in pixels."""
        if estimate is None:
            return None
        found = self.rig.in_units(estimate)
        return found if not self.depth.turn.rad.any() else with_turn(self.rig, found, self.depth.turn.rad)
