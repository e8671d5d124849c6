"""What all methods share: from a frame to its observations, and from a solution to the estimate that is reported.

`Engine` is an Observer with one lane (`lane.py`); `compare` gives what an Observer has observed to several.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import field, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import core
from .camera.models import Camera
from .camera.pixels import FEWEST_BITS, bits_used, image_problem, to_grey, to_uint8
from .camera.rectification import Rectifier
from .camera.rig import MonoRig, StereoRig
from .camera.unseen_errors import PhysicalAxes
from .config import Config
from .errors import ConfigError, FrameError
from .frontend.echo_check import middle
from .frontend.front_end import StereoFrontEnd
from .frontend.image_checks import are_one_image
from .frontend.mono.front_end import MonoFrontEnd
from .frontend.prepared import PreparedImages
from .frontend.state import FrontEndState
from .frontend.still_check import Lines
from .frontend.template_errors import TemplateErrors
from .geometry.se3 import Array
from .geometry.stereo import StereoProjection
from .inertial.samples import ImuSamples
from .inertial.state import SCALE
from .inputs import INT64
from .record import changed, record, rows_of
from .rig_model.estimate import RigEstimate
from .rig_model.terms import TERMS
from .types import (
    CommonErrors,
    ExpectedMotion,
    Frame,
    FrameEstimate,
    InertialEstimate,
    InertialView,
    MonoFrame,
    Observations,
    Prediction,
    RelativeMotions,
    Solution,
    Status,
    StereoFrame,
)

# Between two frames: no camera is faster, and stamps at arrival are further apart. Closer ones seem to count
# milliseconds or frames; σ of a prediction would then be far too small.
_MIN_INTERVAL_NS = 10_000


Expect = Callable[[int, InertialView], ExpectedMotion | None]  # of a stamp, and the samples that come with it


@record
class Observed:
    """The observations of one frame, and what else it takes to make estimates of them.

    `timings_ms`: of each stage that led to them. What the front-end knows with this frame: `errors` that the views of a
    point share; `turn_rad` (3,), by which right views are corrected since frame `turned_at`; `moving`: the homogeneous
    points (n, 4) in view and their twist (6,), None before there was a motion.
    """

    observations: Observations
    timings_ms: dict[str, float]
    errors: TemplateErrors = field(default_factory=TemplateErrors)
    turn_rad: Array = field(default_factory=lambda: np.zeros(3))
    turned_at: int = 0
    moving: tuple[Array, Array] | None = None


class Observer:
    """Rectifies the frames of one rig and runs the front-end on them. Frames come in order of time, from one thread.

    `rig`: the cameras that are used, with `Config.mono` the left one only; `projection`: of the rectified images;
    observations and solutions are in their axes. `state` is all that ever changes, and it is replaced as a whole: who
    keeps one can go on from there again. Raises ConfigError for a rig that cannot work.
    """

    def __init__(self, rig: StereoRig | MonoRig, config: Config) -> None:
        _check_arguments(rig, config)
        self.rig = _used_cameras(rig, config)
        self.rectifier = Rectifier(self.rig)
        self.projection: StereoProjection = self.rectifier.projection
        self._frontend: StereoFrontEnd | MonoFrontEnd
        if isinstance(self.rig, StereoRig):
            self._frontend = StereoFrontEnd(self.rig, self.rectifier, config)
        else:
            self._frontend = MonoFrontEnd(self.projection, config, self.rectifier.valid)
        self.state: FrontEndState = self._frontend.start
        self._smoothing_px = config.frontend.smoothing_px
        self._made_by = f"{self.rectifier.fingerprint} {self._smoothing_px}"
        self._exact = self.rig.unscaled or config.rig.exact  # with one camera no length is known anyway
        unseen = () if self._exact else (config.rig.std_baseline, config.rig.std_axes_rad)
        self._std_axes_rad = config.rig.std_axes_rad
        self._axes = PhysicalAxes(self.rectifier.rect_from_cam, *unseen)
        imu = self.rig.imu if isinstance(self.rig, StereoRig) and config.imu.enabled else None
        self._imu = None if imu is None else imu.mounted_in(self.rectifier.rect_from_cam[:3, :3])

    def prepare(self, frame: Frame, frame_index: int | None = None, grey_bits: int | None = None) -> PreparedImages:
        """Do the work on the images that depends on no other frame; it changes nothing, so any thread may do it.

        With the `frame_index` that the frame will have (frames count from 0) more of the work is done here; the
        observations are the same. 16-bit images are scaled to 8 bits by `grey_bits`, by default as many as they use
        themselves; where frames before have used more, `observe` prepares them anew. Raises FrameError for images of
        the wrong kind.
        """
        self._check_images(frame, "the frame")
        images = [to_grey(image) for image in frame.images[: len(self.rig.cameras)]]
        deep = any(image.dtype == np.uint16 for image in images)
        bits = bits_used(*images) if deep and grey_bits is None else grey_bits
        sides = [to_uint8(image, bits or FEWEST_BITS) for image in images]
        rectified = self.rectifier.rectify(*sides)
        done = self._smoothing_px, frame.stamp_ns, bits, self._made_by
        prepared = PreparedImages.of(rectified[0], rectified[-1], *done)
        if len(sides) > 1:
            left, right = map(Lines.of, sides, (camera.mask for camera in self.rig.cameras.values()))
            prepared = replace(prepared, one_image=are_one_image(*sides), lines=(left, right))
            prepared = replace(prepared, middles=(middle(sides[0]), middle(sides[1])))
        if frame_index is not None:
            self._frontend.prepare(prepared, frame_index)
        return prepared

    def inertial_view(self, frame: Frame) -> InertialView | None:
        """Return the inertial samples of a frame, where they are used, with their calibration in rectified axes."""
        samples = frame.imu if isinstance(frame, StereoFrame) else None
        if samples is not None and not isinstance(samples, ImuSamples):
            raise FrameError(f"imu of the frame is {_described(samples)}; give ImuSamples")
        return None if samples is None else self.view_of(samples)

    def view_of(self, samples: ImuSamples) -> InertialView | None:
        """Return inertial samples with their calibration in rectified axes; None where they are not used."""
        return None if self._imu is None else InertialView(samples, self._imu)

    def observe(
        self, frame: Frame, prepared: PreparedImages | None = None, expect: Expect | None = None
    ) -> Observed:
        """Return the observations of the next frame; `prepared` is what `prepare` returned, if it was called.

        `expect`: gives the motion that an estimator predicts by the inertial samples that come with the frame, from
        which the front-end starts.
        Raises FrameError for images of the wrong kind or a stamp that does not increase; the observer is then
        unchanged.
        """
        index = self.state.frame_index
        where = f"frame {index}"
        self._check_images(frame, where)
        stamp_ns = self._checked_stamp(frame, where)
        if prepared is not None and (problem := self._prepared_problem(frame, prepared)):
            raise FrameError(f"{where}: prepared {problem}; give what `prepare` returned for this frame")
        began = time.perf_counter()
        images = self.prepare(frame, index) if prepared is None else prepared
        grey_bits = max(self.state.grey_bits, images.grey_bits or 0)
        if images.grey_bits not in (None, grey_bits):
            images = self.prepare(frame, index, grey_bits)
        rectified = time.perf_counter()
        state, view = replace(self.state, grey_bits=grey_bits), self.inertial_view(frame)
        expected = None if view is None or expect is None else expect(stamp_ns, view)
        self.state, observations = self._frontend.step(state, images, stamp_ns, expected)
        if view is not None:
            observations = replace(observations, inertial=view)
        timings_ms = {"rectify": 1e3 * (rectified - began), "frontend": 1e3 * (time.perf_counter() - rectified)}
        now, n = self.state, len(observations.track_ids)
        moving = None if now.timing.twist is None else (now.tracks.points[:n], now.timing.twist)
        return Observed(observations, timings_ms, now.errors, now.turn_rad, now.turned_at, moving)

    def reset(self) -> None:
        """Forget all frames: the next one is the first."""
        self.state = self._frontend.start

    def learn(self, solution: Solution | None) -> None:
        """Use what an estimator has found out about the cameras' timing for the frames to come."""
        if solution is not None and solution.rig is not None:
            self.state = self._frontend.learn(self.state, solution.rig)

    def calibrated(self, observed: Observed, errors: RigEstimate | None) -> Observed:
        """Return what would have been observed with a calibration that has not the `errors`, and is exact then.

        They are those of a Solution, None for none: of the rig at rest, and of its timing as far as it is known how the
        points move.
        """
        seen = observed.observations
        if seen.rig is None or errors is None:
            return changed(observed, observations=replace(seen, rig=None))
        model = seen.rig.model
        z_px = seen.z_px - model.error_px(errors, seen.z_px)
        if observed.moving is not None:
            mean_s, cov_s2 = model.timing(errors)
            timing = replace(self._frontend.start.timing, mean=mean_s, cov=cov_s2)
            z_px -= timing.taken_out(*observed.moving)
        return changed(observed, observations=replace(seen, z_px=z_px, rig=None))

    def estimate(self, observed: Observed, solution: Solution, estimator_ms: float) -> FrameEstimate:
        """Turn the solution of an observed frame, in rectified axes, into axes of the physical left camera.

        The covariance of each point gets the disparity error that all its views share. Points seen for the first time
        are not reported yet: one match of left and right may be wrong, and only a second view can tell.
        """
        observations = observed.observations
        solution = solution if solution.inertial is None else _in_metres(solution, solution.inertial.scale)
        axes = self._axes_with(solution.inertial)
        n_old = len(observations.track_ids) - observations.n_new
        shown = np.flatnonzero(~core.among(solution.track_ids, observations.track_ids[n_old:]))
        ids, world_from_cam = solution.track_ids[shown], solution.world_from_cam
        std_shared = self._std_shared(observed.errors, ids)
        in_cam, in_world = (
            axes.points(rows_of(points, shown), rows_of(cov, shown), std_shared, frame_from_cam)
            for points, cov, frame_from_cam in (
                (solution.points_in_cam, solution.cov_points, np.eye(4)),
                (solution.points_in_world, solution.cov_points_in_world, world_from_cam),
            )
        )
        ended = axes.points(
            solution.ended_points_in_world,
            solution.ended_cov_points_in_world,
            self._std_shared(observed.errors, solution.ended_ids),
            solution.window_world_from_cam[0],  # an ended point was seen last about when the window begins
        )
        weights = None if solution.common is None else solution.common.weights(len(TERMS))
        by_common = None if solution.common is None else solution.common.jacobian
        pose = _motions(axes, world_from_cam[None], solution.cov_pose[None], by_common, weights)
        values = {f.name: getattr(solution, f.name) for f in fields(Solution)}  # those that have no axes stay
        return FrameEstimate(
            **values
            | {
                "world_from_cam": pose[0][0],
                "cov_pose": pose[1][0],
                "track_ids": ids,
                "points_in_cam": in_cam[0],
                "cov_points": in_cam[1],
                "points_in_world": in_world[0],
                "cov_points_in_world": in_world[1],
                "window_world_from_cam": axes.poses(solution.window_world_from_cam),
                "ended_points_in_world": ended[0],
                "ended_cov_points_in_world": ended[1],
                "rig": self._frontend.rig_in_px(observed.turn_rad, solution.rig),
                "relative": self._relative(axes, solution.relative, weights),
                "common": self._common(solution, pose[2][0], observed.turned_at),
                "inertial": None if solution.inertial is None else self._turned(solution.inertial),
            },
            frame_index=observations.frame_index,
            stamp_ns=int(observations.stamp_ns),
            counts={
                "tracked": n_old,
                "new": observations.n_new,
                "used": len(solution.track_ids),
                "rejected": len(solution.rejected_ids),
            },
            timings_ms=observed.timings_ms | {"estimator": estimator_ms},
            unscaled=self.rig.unscaled,
            rig_change=None if observations.rig is None else observations.rig.change,
        )

    def prediction(self, found: Prediction) -> Prediction:
        """Turn a prediction in rectified axes into axes of the physical left camera."""
        axes, pose = self._axes_with(found.inertial), found.world_from_cam.copy()
        pose[:3, 3] *= 1 + found.inertial.scale
        poses, cov, _ = _motions(axes, pose[None], found.cov_pose[None], None, None)
        return Prediction(found.stamp_ns, poses[0], cov[0], self._turned(found.inertial))

    def _axes_with(self, inertial: InertialEstimate | None) -> PhysicalAxes:
        """The physical axes, with lengths as uncertain as inertia leaves them."""
        if inertial is None or self._exact:
            return self._axes
        std_scale = float(np.sqrt(inertial.cov_of(SCALE)[0, 0]))
        return PhysicalAxes(self.rectifier.rect_from_cam, std_scale, self._std_axes_rad)

    def _turned(self, inertial: InertialEstimate) -> InertialEstimate:
        """The inertial state in axes of the physical camera."""
        cam_from_rect = self.rectifier.rect_from_cam[:3, :3].T
        turn = np.eye(len(inertial.cov))
        for k in range(0, 12, 3):
            turn[k : k + 3, k : k + 3] = cam_from_rect
        return replace(
            inertial,
            velocity=cam_from_rect @ inertial.velocity,
            gravity=cam_from_rect @ inertial.gravity,
            cov=turn @ inertial.cov @ turn.T,
        )

    def _relative(
        self, axes: PhysicalAxes, relative: RelativeMotions | None, weights: Array | None
    ) -> RelativeMotions | None:
        """Relative motions in axes of the physical camera, with the errors that no view shows."""
        if relative is None:
            return None
        seen = relative.frame_from_newest, relative.cov, relative.common_jacobian
        poses, cov, by_common = _motions(axes, *seen, weights)
        return RelativeMotions(relative.frame_indices, poses, cov, None if self._exact else by_common)

    def _common(self, solution: Solution, jacobian: Array, since: int) -> CommonErrors | None:
        """The errors that all frames `since` one share, and those that no view shows; they move the pose (6, m)."""
        if self._exact or solution.status in (Status.INITIALISING, Status.LOST):
            return None
        if solution.common is None:
            return CommonErrors(np.zeros(3), np.eye(3), jacobian, since)
        t = len(TERMS)
        cov = np.eye(3 + t)
        cov[3:, 3:] = solution.common.cov[:t, :t]
        mean = np.concatenate([np.zeros(3), solution.common.mean[:t]])
        return CommonErrors(mean, cov, jacobian, since)

    def _std_shared(self, errors: TemplateErrors, track_ids: NDArray[np.int64]) -> Array:
        """Return σ (n,) of inverse depths, 1/m, by the disparity error that all views of a point share, eq. (18)."""
        return errors.std_disparity_px(track_ids) / (self.projection.f_px * self.projection.baseline_m)

    def _check_images(self, frame: Frame, where: str) -> None:
        """Raise a FrameError where the images are not those of the cameras; `where`: which frame it is."""
        if not isinstance(frame, StereoFrame | MonoFrame):
            raise FrameError(f"{where} is {_described(frame)}; give a StereoFrame(stamp_ns, left, right)")
        where = f"{where} (stamp {frame.stamp_ns} ns)"
        cameras, images = self.rig.cameras, frame.images
        if len(images) < len(cameras):
            raise FrameError(f"{where}: one image only; give a StereoFrame, or estimate with Config(mono=True)")
        for (side, camera), image in zip(cameras.items(), images, strict=False):
            if problem := image_problem(image):
                raise FrameError(f"{where}: the {side} image {problem}")
            if image.shape[:2] != (camera.height, camera.width):
                raise FrameError(
                    f"{where}: the {side} image has shape {image.shape}, the calibration says "
                    f"({camera.height}, {camera.width}); {_size_fix(image.shape, camera)}"
                )

    def _prepared_problem(self, frame: Frame, prepared: object) -> str:
        """Why something is not what `prepare` returned for a frame; empty where it is."""
        if not isinstance(prepared, PreparedImages):
            return f"is {_described(prepared)}"
        if prepared.left.shape != self.rectifier.valid.shape:
            return f"has shape {prepared.left.shape}, the calibration says {self.rectifier.valid.shape}"
        if prepared.made_by != self._made_by:
            return "was made by an engine of another calibration or smoothing"
        if prepared.stamp_ns != frame.stamp_ns:
            return f"is of the frame with stamp {prepared.stamp_ns} ns, this one has {frame.stamp_ns} ns"
        return ""

    def _checked_stamp(self, frame: Frame, where: str) -> int:
        """Return the stamp as a Python integer. Raises FrameError where it is not one after that of the last frame."""
        if isinstance(frame.stamp_ns, bool) or not isinstance(frame.stamp_ns, int | np.integer):
            raise FrameError(f"{where}: stamp_ns is {_described(frame.stamp_ns)}; {_stamp_fix(frame.stamp_ns)}")
        stamp_ns, last_ns = int(frame.stamp_ns), self.state.stamp_ns  # differences of small NumPy types overflow
        if not -INT64 <= stamp_ns < INT64:
            raise FrameError(f"{where}: stamp_ns is beyond 64 bits; give an integer number of nanoseconds")
        if last_ns is not None and stamp_ns <= last_ns:
            raise FrameError(
                f"{where} (stamp {stamp_ns} ns): stamps must increase, and the last frame had "
                f"{last_ns} ns; drop this frame, or make a new engine if the clock was set back"
            )
        if self.state.frame_index == 1 and (apart_ns := stamp_ns - (last_ns or 0)) < _MIN_INTERVAL_NS:
            logging.getLogger("stream_sfm").warning(
                f"{where} (stamp {stamp_ns} ns) is {apart_ns} ns after the first one: stamps are nanoseconds; of "
                "milliseconds that is stamp * 10**6, of a frame counter round(count / frames_per_s * 1e9)"
            )
        return stamp_ns


def _motions(
    axes: PhysicalAxes, poses: Array, cov: Array, by_rig: Array | None, weights: Array | None
) -> tuple[Array, Array, Array]:
    """Poses (n, 4, 4), covariances and perturbations by common errors, as `PhysicalAxes.motions` turns them.

    Of the rig's errors, by which they are moved (…, 6, m), the physical terms count: the field over the image is
    what these tell of it, by `weights` (m, t); the rest is the motion's own.
    """
    of_terms = None if by_rig is None or weights is None else (by_rig @ weights).reshape(len(poses), 6, -1)
    return axes.motions(poses, cov, of_terms)


def _in_metres(solution: Solution, scale: float) -> Solution:
    """Return a solution whose lengths by images are too short by a share of themselves in metres."""
    if not scale:
        return solution
    k = 1 + scale

    def longer(poses: Array) -> Array:
        return np.concatenate([poses[..., :3], poses[..., 3:] * np.array([k, k, k, 1.0])[:, None]], axis=-1)

    lengths = np.diag(np.repeat([k, 1.0], 3))
    relative, common = solution.relative, solution.common
    if relative is not None:
        by_common = None if relative.common_jacobian is None else lengths @ relative.common_jacobian
        motions, cov = longer(relative.frame_from_newest), lengths @ relative.cov @ lengths
        relative = RelativeMotions(relative.frame_indices, motions, cov, by_common)
    return replace(
        solution,
        world_from_cam=longer(solution.world_from_cam),
        cov_pose=lengths @ solution.cov_pose @ lengths,
        points_in_cam=k * solution.points_in_cam,
        cov_points=k**2 * solution.cov_points,
        points_in_world=k * solution.points_in_world,
        cov_points_in_world=k**2 * solution.cov_points_in_world,
        ended_points_in_world=k * solution.ended_points_in_world,
        ended_cov_points_in_world=k**2 * solution.ended_cov_points_in_world,
        window_world_from_cam=longer(solution.window_world_from_cam),
        relative=relative,
        common=None if common is None else replace(common, jacobian=lengths @ common.jacobian),
    )


def _used_cameras(rig: StereoRig | MonoRig, config: Config) -> StereoRig | MonoRig:
    """Return the rig to estimate with. Only here is `Config.mono` asked; everything else asks the rig."""
    rig = config.masked(rig)
    if config.mono:
        if isinstance(rig, StereoRig) and rig.timing is not None:
            logging.getLogger("stream_sfm").warning(
                "the calibration's [timing] is not used with one camera: estimates do not know of its readout"
            )
        return MonoRig(rig.left)
    if rig.unscaled:
        raise ConfigError("a rig of one camera needs Config(mono=True); its results have no scale")
    return rig


def _check_arguments(rig: object, config: object) -> None:
    """Raise a ConfigError that says what was given and what is wanted."""
    if not isinstance(rig, StereoRig | MonoRig):
        example = repr(str(rig)) if isinstance(rig, str | Path) else "'calibration.toml'"
        raise ConfigError(
            f"the rig is {_described(rig)}; give a StereoRig or a MonoRig, such as "
            f"StereoRig.from_calibration({example})"
        )
    if not isinstance(config, Config):
        example = repr(str(config)) if isinstance(config, str | Path) else "'settings.toml'"
        raise ConfigError(
            f"the configuration is {_described(config)}; give a Config, such as read_config({example})"
        )


def _stamp_fix(stamp: object) -> str:
    """Say how to convert a stamp of another kind to nanoseconds."""
    fix = "give an integer number of nanoseconds"
    if isinstance(stamp, float | np.floating):
        return f"{fix}: of seconds, round(seconds * 1e9)"
    if hasattr(stamp, "sec") and hasattr(stamp, "nanosec"):
        return f"{fix}: stamp.sec * 10**9 + stamp.nanosec"
    if isinstance(stamp, np.datetime64):
        return f"{fix}: int(stamp.astype('datetime64[ns]').astype(int))"
    if hasattr(stamp, "timestamp"):
        return f"{fix}: round(stamp.timestamp() * 1e9)"
    return fix


def _size_fix(shape: tuple[int, ...], camera: Camera) -> str:
    """Say what to do about an image of another size."""
    height, width = shape[:2]
    if (height, width) == (camera.width, camera.height):
        return "give (h, w), not (w, h): image.T, or the calibration of a camera that stands upright"
    if (height, width) == (camera.height, 2 * camera.width):
        return f"give its halves, if left and right are side by side: image[:, :{camera.width}] and the rest"
    if width * camera.height == height * camera.width:
        return "give images of the calibrated size, or the calibration of this one (K scales with the images)"
    return "give images of the calibrated size, not cropped, or the calibration of this one"


def _described(value: object) -> str:
    """Describe an argument of the wrong kind in a few words."""
    if value is None:
        return "None"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    text = f" ({value!r})" if isinstance(value, str | int | float | Path) else ""
    return f"of type {type(value).__name__}{text}"
