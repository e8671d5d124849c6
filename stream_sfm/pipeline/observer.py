"""The part that all methods share: from a frame to its observations; `physical` turns solutions into estimates.

`Engine` is an Observer with one lane (`lane.py`); `compare` gives the observations of one Observer to several lanes.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..camera.pixels import FEWEST_BITS, bits_used, to_grey, to_uint8
from ..camera.rectification import Rectifier
from ..camera.rig import MonoRig, StereoRig
from ..config import Config
from ..errors import FrameError
from ..frontend.front_end import StereoFrontEnd
from ..frontend.state import FrontEndState
from ..geometry.resection import MANY_VIEWS
from ..geometry.robust_rules import RobustRules
from ..geometry.stereo import StereoProjection
from ..inertial.samples import ImuSamples
from ..pictures.prepared import Delivered, PreparedImages
from ..pictures.rules import FlowRules, ImageRules
from ..record import changed
from ..rig_model.estimate import RigEstimate
from ..system.wording import described
from ..types import ExpectedMotion, Frame, InertialView, Observations, Solution, StereoFrame
from .checked import check_arguments, check_images, checked_stamp, used_cameras
from .physical import Observed as Observed
from .physical import PhysicalEstimates

if TYPE_CHECKING:
    from ..frontend.mono.front_end import MonoFrontEnd

Expect = Callable[[int, InertialView], ExpectedMotion | None]  # from a stamp and the samples that come with it


_EXCHANGED = "left and right are exchanged in this frame, as points in both show; it is used the other way round"


class Observer:
    """Rectifies the frames of one rig and runs the front-end on them. Frames come in order of time, from one thread.

    `rig`: the cameras in use, with `Config.mono` the left one only; `projection`: of the rectified images; observations
    and solutions are in their axes. Only `state` ever changes, and it is replaced as a whole: a caller who keeps one
    can continue from it later. Raises ConfigError for a rig that cannot work.
    """

    def __init__(self, rig: StereoRig | MonoRig, config: Config) -> None:
        check_arguments(rig, config)
        self.rig = used_cameras(rig, config)
        self.rectifier = Rectifier(self.rig)
        self.projection: StereoProjection = self.rectifier.projection
        self._frontend = _front_end(self.rig, self.rectifier, config)
        self.state: FrontEndState = self._frontend.start
        self._smoothing_px, rules = config.frontend.smoothing_px, config.rules
        self._images, self._flow, self._robust = rules.of(ImageRules), rules.of(FlowRules), rules.of(RobustRules)
        self._made_by = f"{self.rectifier.fingerprint} {self._smoothing_px} {self._images} {self._flow}"
        self.physical = PhysicalEstimates(self.rectifier, self._frontend, config.rig, self.rig.unscaled)
        imu = self.rig.imu if isinstance(self.rig, StereoRig) and config.imu.enabled else None
        self._imu = None if imu is None else imu.mounted_in(self.rectifier.rect_from_cam[:3, :3])

    def prepare(self, frame: Frame, frame_index: int | None = None) -> PreparedImages:
        """Do the part of the work on the images that does not depend on other frames; any thread may call this.

        The observer is not changed. With the `frame_index` that the frame will have (frames count from 0) more of the
        work is done here; the observations are the same. 16-bit images are scaled to 8 bits by as many as they use
        themselves; if earlier frames have used more, `observe` prepares them again. Raises FrameError for images of the
        wrong kind.
        """
        check_images(self.rig.cameras, frame, "the frame")
        return self._prepared(frame, frame_index)

    def inertial_view(self, frame: Frame) -> InertialView | None:
        """Return the inertial samples of a frame, if they are used, with their calibration in rectified axes."""
        samples = frame.imu if isinstance(frame, StereoFrame) else None
        if samples is not None and not isinstance(samples, ImuSamples):
            raise FrameError(f"imu of the frame is {described(samples)}; give ImuSamples")
        return None if samples is None else self.view_of(samples)

    def view_of(self, samples: ImuSamples) -> InertialView | None:
        """Return inertial samples with their calibration in rectified axes; None if they are not used."""
        return None if self._imu is None else InertialView(samples, self._imu)

    def observe(self, frame: Frame, prepared: PreparedImages | None = None, expect: Expect | None = None) -> Observed:
        """Return the observations of the next frame; `prepared`: the result of `prepare`, if it was called.

        `expect`: returns the motion that an estimator predicts from the inertial samples of the frame; the front-end
        starts from it. Raises FrameError for images of the wrong kind or a stamp that does not increase; the observer
        is then unchanged.
        """
        index = self.state.frame_index
        where = f"frame {index}"
        check_images(self.rig.cameras, frame, where)
        stamp_ns = checked_stamp(frame, where, self.state.stamp_ns, index == 1)
        if prepared is not None and (problem := self._prepared_problem(frame, prepared)):
            raise FrameError(f"{where}: prepared {problem}; give what `prepare` returned for this frame")
        began = time.perf_counter()
        images = self._prepared(frame, index) if prepared is None else prepared
        grey_bits = max(self.state.grey_bits, images.grey_bits or 0)
        if images.grey_bits not in (None, grey_bits):
            images = self._prepared(frame, index, grey_bits)
        rectified = time.perf_counter()
        state, view = changed(self.state, grey_bits=grey_bits), self.inertial_view(frame)
        expected = None if view is None or expect is None else expect(stamp_ns, view)
        self.state, observations = self._step(state, frame, images, stamp_ns, expected)
        if view is not None:
            observations = replace(observations, inertial=view)
        timings_ms = {"rectify": 1e3 * (rectified - began), "frontend": 1e3 * (time.perf_counter() - rectified)}
        now, n = self.state, len(observations.track_ids)
        moving = None if now.timing.twist is None else (now.tracks.points[:n], now.timing.twist)
        return Observed(observations, timings_ms, now.errors, now.turn_rad, now.turned_at, moving)

    def _step(
        self,
        state: FrontEndState,
        frame: Frame,
        images: PreparedImages,
        stamp_ns: int,
        expected: ExpectedMotion | None,
    ) -> tuple[FrontEndState, Observations]:
        """Step the front-end; if hardly any point is found in both images, try them with left and right exchanged.

        Where that explains a frame, it is used so. A right camera that stays covered is tried once only.
        """
        after, seen = self._frontend.step(state, images, stamp_ns, expected)
        n, n_in_both = _followed(seen)
        enough, alike = self._robust.min_inliers, frame.images[0].shape == frame.images[-1].shape
        if n < MANY_VIEWS or n_in_both >= enough or state.pair.problem or not alike or len(self.rig.cameras) == 1:
            return after, seen
        exchanged = self._prepared(frame, state.frame_index, images.grey_bits, exchanged=True)
        other_after, other = self._frontend.step(state, exchanged, stamp_ns, expected)
        if other_after.pair.problem or _followed(other)[1] < enough:
            return after, seen
        return other_after, replace(other, note=other.note or _EXCHANGED)

    def reset(self) -> None:
        """Forget all frames, so that the next frame is the first."""
        self.state = self._frontend.start

    def learn(self, solution: Solution | None) -> None:
        """Use an estimator's estimate of the cameras' timing for later frames."""
        if solution is not None and solution.rig is not None:
            self.state = self._frontend.learn(self.state, solution.rig)

    def calibrated(self, observed: Observed, errors: RigEstimate | None) -> Observed:
        """Return the observations as with a calibration without the `errors`, which then counts as exact.

        `errors`: of a Solution, None for none. Those of the rig at rest are removed, and those of its timing if the
        motion of the points is known.
        """
        seen = observed.observations
        if seen.rig is None or errors is None:
            return changed(observed, observations=replace(seen, rig=None))
        model = seen.rig.model
        z_px = seen.z_px - model.error_px(errors, seen.z_px)
        if observed.moving is not None:
            mean_s, cov_s2 = model.timing(errors)
            timing = changed(self._frontend.start.timing, mean=mean_s, cov=cov_s2)
            z_px -= timing.taken_out(*observed.moving)
        return changed(observed, observations=replace(seen, z_px=z_px, rig=None))

    def _prepared(
        self, frame: Frame, frame_index: int | None, grey_bits: int | None = None, exchanged: bool = False
    ) -> PreparedImages:
        """Prepare images that have been checked, left as right if they are `exchanged`; see `prepare`."""
        images = [to_grey(image) for image in frame.images[: len(self.rig.cameras)]][:: -1 if exchanged else 1]
        deep = any(image.dtype == np.uint16 for image in images)
        bits = bits_used(*images) if deep and grey_bits is None else grey_bits
        sides = [to_uint8(image, bits or FEWEST_BITS) for image in images]
        rectified, pair = self.rectifier.rectify(*sides), len(sides) > 1
        prepared = PreparedImages.of(
            rectified[0],
            rectified[-1],
            self._smoothing_px,
            stamp_ns=frame.stamp_ns,
            grey_bits=bits,
            made_by=self._made_by,
            delivered=Delivered.of(sides[0], sides[-1], self._images.spacing_px) if pair else None,
            rules=self._flow,
        )
        if frame_index is not None:
            self._frontend.prepare(prepared, frame_index)
        return prepared

    def _prepared_problem(self, frame: Frame, prepared: object) -> str:
        """Return why an object is not the result of `prepare` for a frame; empty if it is."""
        if not isinstance(prepared, PreparedImages):
            return f"is {described(prepared)}"
        if prepared.left.shape != self.rectifier.valid.shape:
            return f"has shape {prepared.left.shape}, the calibration says {self.rectifier.valid.shape}"
        if prepared.made_by != self._made_by:
            return "was made by an engine of another calibration or smoothing"
        if prepared.stamp_ns != frame.stamp_ns:
            return f"is of the frame with stamp {prepared.stamp_ns} ns, this one has {frame.stamp_ns} ns"
        return ""


def _followed(seen: Observations) -> tuple[int, int]:
    """Return how many tracks were followed in a frame, and how many of them were found in both images."""
    n = len(seen.z_px) - seen.n_new
    return n, int(np.count_nonzero(np.isfinite(seen.z_px[:n, 2])))


def _front_end(rig: StereoRig | MonoRig, rectifier: Rectifier, config: Config) -> "StereoFrontEnd | MonoFrontEnd":
    """Return the front-end of a rig; that of one camera is imported only if it is used."""
    if isinstance(rig, StereoRig):
        return StereoFrontEnd(rig, rectifier, config)
    from ..frontend.mono.front_end import MonoFrontEnd

    return MonoFrontEnd(rectifier.projection, config, rectifier.valid)
