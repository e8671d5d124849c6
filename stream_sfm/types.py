"""The frozen records that modules hand to each other, and the protocols of those that take them.

Arrays are float64 unless stated otherwise, and are never written to. A record is equal only to itself, and its `repr`
is one short line.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from .errors import ConfigError
from .geometry.se3 import Array
from .inertial.samples import ImuCalibration, ImuSamples
from .inertial.state import GRAVITY
from .inertial.upright import BODY_FROM_CAMERA_AXES, Upright
from .record import About, Kind
from .rig_model.estimate import RigEstimate
from .rig_model.model import RigModel

Image = NDArray[np.uint8] | NDArray[np.uint16]  # (h, w) or (h, w, 1) grey, (h, w, 3) or (h, w, 4) with blue first
_POSE_AND_GRAVITY = [*range(6), *range(6 + GRAVITY.start, 6 + GRAVITY.stop)]  # rows of `InertialEstimate.cov`
_LEAST_VARIANCE = 1e-9  # of an error of the rig, in σ²: one that is known says nothing of the others
Picture = Image | bytes  # an image, or a compressed one (PNG, JPEG, WebP)


class Status(StrEnum):
    """How far the estimate of a frame can be trusted; `FrameEstimate.reason` says why."""

    INITIALISING = "initialising"  # the first frame of a map; its pose is known by definition or by prediction
    OK = "ok"
    DEGRADED = "degraded"  # estimated from few points, or from points in an unfavourable arrangement
    LOST = "lost"  # predicted only; the covariance grows accordingly


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StereoFrame:
    """Two images of the same moment as the cameras deliver them: `stamp_ns` an integer.

    Images are uint8 or uint16: grey (h, w) or (h, w, 1), or colour as OpenCV has it, blue first: (h, w, 3), (h, w, 4).

    `pictures`, if given, are what a viewer shows: the same images, for instance as the JPEG bytes they arrived in.
    `imu`: the inertial samples since the frame before, and one beyond, if there are any.
    """

    stamp_ns: int
    left: Image
    right: Image
    pictures: tuple[Picture, ...] = ()
    imu: ImuSamples | None = None

    @property
    def images(self) -> tuple[Image, ...]:
        """Both images."""
        return self.left, self.right

    def __repr__(self) -> str:
        return f"<{type(self).__name__} at {self.stamp_ns} ns, {_size(self.left)} and {_size(self.right)}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MonoFrame:
    """One image of a camera that has no partner; everything as in StereoFrame."""

    stamp_ns: int
    left: Image
    pictures: tuple[Picture, ...] = ()

    @property
    def images(self) -> tuple[Image, ...]:
        """The one image."""
        return (self.left,)

    def __repr__(self) -> str:
        return f"<MonoFrame at {self.stamp_ns} ns, {_size(self.left)}>"


Frame = StereoFrame | MonoFrame


@dataclass(frozen=True, slots=True)
class Selection:
    """Says which frames of a log are used; without arguments all of them.

    First those from `start_s` to `end_s`, seconds after the first frame, both included; of these every `stride`-th;
    of these the first `max_frames`. Raises ConfigError for a selection that cannot contain a frame.
    """

    start_s: float | None = None
    end_s: float | None = None
    max_frames: int | None = None
    stride: int = 1

    def __post_init__(self) -> None:
        for name in ("start_s", "end_s"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, int | float) and 0 <= value < math.inf):
                raise ConfigError(f"{name} is {value!r}; give seconds from the first frame, 0 or more")
        for name in ("max_frames", "stride"):
            value = getattr(self, name)
            if (value is not None or name == "stride") and (not isinstance(value, int) or value < 1):
                raise ConfigError(f"{name} is {value!r}; give a whole number of at least 1")
        if self.start_s is not None and self.end_s is not None and self.end_s < self.start_s:
            raise ConfigError(f"the end, {self.end_s:g} s, lies before the start, {self.start_s:g} s")

    @property
    def is_everything(self) -> bool:
        """Whether no frame is left out."""
        return self == Selection()

    def count(self, frames: int | None) -> int | None:
        """Return how many of a log's frames are used at most; None where that is not known."""
        if self.start_s is not None or self.end_s is not None or frames is None:
            return self.max_frames
        used = -(-frames // self.stride)
        return used if self.max_frames is None else min(used, self.max_frames)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MapStart:
    """All that a front-end with one camera knows about the depths in a frame, for a map to start from.

    `z_px` (n, 4), `cov_px` (n, 4, 4): the frame's views with virtual right sides made of those depths.
    `first_from_cam` (4, 4), `cov_first_from_cam` (6, 6): the motion since the frame whose distance is the unit.
    """

    z_px: Array
    cov_px: Array
    first_from_cam: Array
    cov_first_from_cam: Array

    def __repr__(self) -> str:
        return f"<MapStart {len(self.z_px)} views>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LastingErrors:
    """Temporally correlated view errors of a frame (n).

    `std_drift_px` (n,): how far a patch may have slid over its surface since the previous frame, where it is seen from
    a changing direction; None where points are exact. `inflation` (n, 2): factors on the variances of left and right
    side for an estimator that adds up the views of a track as if they were independent; None where they are.
    `std_turn_rad`: σ about each axis of the turn since the previous frame that patches feign which slide alike.
    """

    std_drift_px: Array | None = None
    inflation: Array | None = None
    std_turn_rad: float = 0.0

    def __repr__(self) -> str:
        return f"<LastingErrors of {0 if self.std_drift_px is None else len(self.std_drift_px)} views>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Ambiguity:
    """Why the motion that the views show may not be the camera's.

    `other_from_previous` (4, 4): another motion since the previous frame that may as well be the camera's, and its
    covariance `cov_other` (6, 6), of the perturbation on the right of its inverse; or None. `lasted`: for how many
    frames before this one what was followed may have moved by itself already. `misfit`: the images do not fit each
    other or the calibration; the note of the observations says why. `of_start`: it is so since the map began.
    """

    other_from_previous: Array | None = None
    cov_other: Array | None = None
    misfit: bool = False
    lasted: int = 0
    of_start: bool = False

    def __repr__(self) -> str:
        return f"<Ambiguity: {'' if self.other_from_previous is None else 'two motions '}{'misfit' * self.misfit}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RigView:
    """What errors of the rig do to the views (n) of a frame.

    `model`: the linear model of all of them. `field_std_px`: σ of those errors that no physical term follows, as the
    rows have it so far. `timing_px` (n, 4): view shifts predicted from the current delay and readout; `z_px` is
    uncorrected. `delay_by_rows`: the information that the rows have about the delay of the right camera, s⁻²,
    and its sum weighted by that, s⁻¹. `turn_root` (3, e): a root of the covariance of turns that the right camera has
    from frame to frame, radians. `change`: the right camera has turned against the left one; the turn is taken
    out of the views from this frame on, and `change_root` (m, j) is a root of the covariance of what is left, in σ of
    each error.
    """

    model: RigModel
    field_std_px: float = 0.0
    timing_px: Array | float = 0.0
    delay_by_rows: tuple[float, float] = (0.0, 0.0)
    turn_root: Array = field(default_factory=lambda: np.zeros((3, 0)))
    change: "RigChange | None" = None
    change_root: Array | None = None

    def __repr__(self) -> str:
        return f"<RigView {len(self.model)} errors{'' if self.change is None else ', changed'}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class InertialView:
    """The inertial `samples` that came with a frame, and the `calibration` of their unit, in rectified axes."""

    samples: ImuSamples
    calibration: ImuCalibration

    def __repr__(self) -> str:
        return f"<InertialView {len(self.samples)} samples>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ExpectedMotion:
    """The motion that inertial samples predict from the frame at `since_ns` on.

    `previous_from_cam` (4, 4) with its covariance `cov` (6, 6), right perturbation; `twist` (6,): how points of the
    scene move in the camera at the end, m/s and rad/s. `carried`: it is from before the present map, whose start it can
    judge.
    """

    since_ns: int
    previous_from_cam: Array
    cov: Array
    twist: Array
    carried: bool = False

    def __repr__(self) -> str:
        return f"<ExpectedMotion since {self.since_ns} ns>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class InertialEstimate:
    """The inertial state of a frame, in axes of the camera; SI and radians.

    `velocity` (3,); `gravity` (3,): its direction and size, as a falling body would be accelerated; `gyro_bias` (3,),
    `accel_bias` (3,), in axes of the unit; `scale`: by which share lengths by images alone are too short, as already
    corrected; `axes_rad` (3,): turn of the unit against its calibration; `time_offset_s`: beyond the calibrated one.
    `cov` (23, 23): joint, of the pose's perturbation (6), then these 17 in order. `densities` (2,): factors on the
    noise densities of gyroscope and accelerometer, as learnt. `distance2`: squared distance of the images' motion from
    that of the samples, 6 expected. `dead_reckoned`: the pose is by the samples alone. `note`: what is wrong with them.
    """

    velocity: Array
    gravity: Array
    gyro_bias: Array
    accel_bias: Array
    scale: float
    axes_rad: Array
    time_offset_s: float
    cov: Array
    densities: Array
    distance2: float = 0.0
    dead_reckoned: bool = False
    note: str = ""

    def cov_of(self, part: slice) -> Array:
        """Return the covariance (k, k) of a part of the state, one of those in `inertial/state.py`."""
        return self.cov[6:, 6:][part, part]

    @property
    def std_tilt_rad(self) -> float:
        """σ of the direction of gravity in the camera, the larger one of two."""
        size = float(np.linalg.norm(self.gravity))
        across = np.linalg.svd(self.gravity[None] / size)[2][1:]
        return float(np.sqrt(np.linalg.eigvalsh(across @ self.cov_of(GRAVITY) @ across.T)[-1])) / size

    def __repr__(self) -> str:
        return (
            f"<InertialEstimate {np.linalg.norm(self.velocity):.2f} m/s, tilt ±{1e3 * self.std_tilt_rad:.1f} mrad>"
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Observations:
    """What the front-end found in one frame, in pixels of the rectified images.

    - `track_ids` (n,) int64, unique, ascending: a point keeps its id while it is tracked; an id that is missing in
      one frame does not return, unless that frame was skipped and has no ids at all. The last `n_new` are new.
    - `z_px` (n, 4) = (u_left, v_left, u_right, v_right), `cov_px` (n, 4, 4): the views; the right side is NaN where
      it was not found. The first view of a point has both sides.
    - `cam_from_previous` (4, 4): the front-end's own robust motion since the previous frame, as a start value; or
      None.
    - `note`: what the front-end noticed, such as "image is black"; or empty.
    - `ambiguity`: why the motion may not be the camera's; None where nothing says so.
    - `jumped`: all of the view has changed at once, and no velocity says where the camera is.
    - `settled`: of the two motions of the frames before, the one that was followed was the camera's.
    - `unconfirmed`: a misfit since the map began has ended, and nothing has shown that the motion was the camera's.
    - `stepped`: both images may have been displaced at once in the frame before, which looks like a turn of the camera.
    - `lasting`: errors that the views share with those of earlier frames.
    - `rig`: what errors of the rig do to the views; None where the calibration is exact.
    - `start`: with one camera, what a map can start from, as soon as depths are known.
    - `inertial`: samples of an inertial unit since the frame before, and how it is mounted.
    """

    frame_index: int
    stamp_ns: int
    track_ids: NDArray[np.int64]
    z_px: Array
    cov_px: Array
    cam_from_previous: Array | None = None
    n_new: int = 0
    note: str = ""
    ambiguity: Ambiguity | None = None
    jumped: bool = False
    settled: bool = False
    unconfirmed: bool = False
    stepped: bool = False
    lasting: LastingErrors = field(default_factory=LastingErrors)
    rig: RigView | None = None
    start: MapStart | None = None
    inertial: InertialView | None = None

    @property
    def misfit(self) -> bool:
        """Whether images and calibration do not fit each other."""
        return self.ambiguity is not None and self.ambiguity.misfit

    def __repr__(self) -> str:
        note = f", {self.note}" if self.note else ""
        return f"<Observations {self.frame_index} {len(self.track_ids)} points, {self.n_new} new{note}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RigChange:
    """The right camera has turned against the left one during the run, as by a knock.

    `frame_index`: the first frame that shows it; `turn_rad` (3,): about x, y and z of the rectified axes; `shift_px`:
    how far the right image has moved, and `disparity_px`: the same along the rows, root mean squares over the image;
    `error_per_m`: by which share distances would be wrong from then on, per metre of distance.
    """

    frame_index: Annotated[int, About(Kind.FRAMES)]
    turn_rad: Array
    shift_px: float
    disparity_px: float
    error_per_m: float

    def __str__(self) -> str:
        pitch, yaw, roll = 1e3 * self.turn_rad
        return (
            f"from frame {self.frame_index} on the right camera is turned against the left one (pitch {pitch:+.2f}, "
            f"yaw {yaw:+.2f}, roll {roll:+.2f} mrad) and its image moved by {self.shift_px:.2f} px: was a camera "
            "knocked? The turn is corrected; uncorrected, distances of 10 m would be off by "
            f"{10 * self.error_per_m:.1%}"
        )

    def __repr__(self) -> str:
        return f"<RigChange at frame {self.frame_index}, {self.shift_px:.2f} px>"


def _no_ids() -> NDArray[np.int64]:
    return np.empty(0, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RelativeMotions:
    """Motions between the newest frame and earlier ones (r), each with its covariance.

    `frame_indices` (r,); `frame_from_newest` (r, 4, 4) carries points of the newest camera into the earlier one;
    `cov` (r, 6, 6) of the perturbation on its right, translation first: metres², radians². `common_jacobian`
    (r, 6, m): how much of that perturbation each of the `CommonErrors` of the frame makes; None as those.
    """

    frame_indices: Annotated[
        NDArray[np.int64],
        About(Kind.FRAMES, (-1,), says="earlier frames, to which the motion from this one is known"),
    ]
    frame_from_newest: Annotated[
        Array, About(shape=(-1, 4, 4), says="carry points of this camera into theirs, each 4×4, metres")
    ]
    cov: Annotated[
        Array, About(shape=(-1, 6, 6), says="6×6 covariances of ξ in truth = frame_from_newest·Exp(ξ), as cov_pose")
    ]
    common_jacobian: Annotated[
        Array | None,
        About(shape=(-1, 6, "m"), says="how common errors move these motions, each 6×m row by row"),
    ] = None

    def __repr__(self) -> str:
        return f"<RelativeMotions to frames {self.frame_indices.tolist()}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CommonErrors:
    """Errors c (m,) that all poses and motions of a run have in common, so that no number of frames averages them out.

    First those that no view shows: of all lengths, and of the camera's axes about its x and y; then the physical terms
    of the rig (of a Solution the whole of it, and only that). In σ of what is assumed for each beforehand.
    This frame was estimated with c = `mean` (m,), and knows it with `cov` (m, m). `jacobian` (6, m): truth =
    world_from_cam·Exp(jacobian (c − mean) + own), where `own` has the covariance cov_pose − jacobian cov jacobianᵀ; so
    do the motions of `RelativeMotions`, eq. (74a). c is that of all frames from `since` on: where a camera is knocked,
    or the log has another calibration, another c begins.
    """

    mean: Annotated[
        Array,
        About(shape=("m",), says="errors c that all poses and motions share, of lengths, axes and rig; or empty"),
    ]
    cov: Annotated[Array, About(shape=("m", "m"), says="their covariance, m×m row by row")]
    jacobian: Annotated[
        Array, About(shape=(6, "m"), says="how they move the pose, 6×m row by row; c is in σ of what was assumed")
    ]
    since: Annotated[
        int, About(Kind.FRAMES, says="the frame from which c is that of the rig; a knock begins another c")
    ] = 0

    def weights(self, n: int) -> Array:
        """Return W (m, n), the regression of c on its first n: c is W c[:n] plus an independent remainder."""
        known = self.cov[:n, :n] + _LEAST_VARIANCE * np.eye(n)
        return np.concatenate([np.eye(n), np.linalg.solve(known, self.cov[:n, n:]).T])

    def __repr__(self) -> str:
        return f"<CommonErrors {len(self.mean)} terms>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Solution:
    """The result of an estimator for one frame, in the axes of the rectified left camera; lengths in metres.

    - `status`, and `reason`: why it is not ok.
    - `world_from_cam` (4, 4): the pose; the world is the left camera of the first frame. `cov_pose` (6, 6): of the
      perturbation on its right, translation first; metres², radians².
    - `track_ids` (n,), `points_in_cam` (n, 3), `cov_points` (n, 3, 3): the local structure, points seen now in
      camera axes; `points_in_world`, `cov_points_in_world`: the same points in the world.
    - `ended_ids` (k,), `ended_points_in_world` (k, 3), `ended_cov_points_in_world` (k, 3, 3): points that left the
      estimator with this frame, as they are in the end.
    - `window_frame_indices` (b,), `window_world_from_cam` (b, 4, 4): all poses of the window, the oldest first.
    - `rejected_ids`: points whose views in this frame were judged to be outliers. `iterations`: of the solver.
    - `nis`, `nis_dof`: whitened squared innovation of the accepted views, and its degrees of freedom.
    - `rig`: the estimated errors of the calibration; None where it is taken as exact.
    - `relative`: the motions between this frame and those of the window, for fusion. None where the method has no joint
      covariance of them, or where left and right image are inconsistent.
    - `common`: the errors that all poses and motions share, and their effect on `world_from_cam`, for fusion. None
      where the rig is taken as exact, where the pose is only predicted, and in the first frame of a map.
    - `inertial`: velocity, gravity and biases; None without inertial samples.
    """

    status: Annotated[Status, About(says="initialising, ok, degraded or lost", column=True)]
    reason: Annotated[str, About(says="why the status is not ok; may be empty")]
    world_from_cam: Annotated[
        Array,
        About(Kind.POSES, (4, 4), says="pose of the left camera in the world, 4×4 row by row, metres; z forward"),
    ]
    cov_pose: Annotated[
        Array,
        About(
            *(Kind.COV_POSE, (6, 6), "world_from_cam"),
            "6×6 covariance of ξ in truth = world_from_cam·Exp(ξ), ξ = (translation m, rotation rad) in camera axes",
        ),
    ]
    track_ids: Annotated[NDArray[np.int64], About(Kind.TRACKS)]
    points_in_cam: Array
    cov_points: Array
    points_in_world: Annotated[Array, About(Kind.POINTS)]
    cov_points_in_world: Annotated[Array, About(Kind.COV_POINTS, of="points_in_world")]
    window_frame_indices: Annotated[
        NDArray[np.int64], About(Kind.FRAMES, (-1,), says="frames in the estimator's window, oldest first")
    ]
    window_world_from_cam: Annotated[
        Array, About(Kind.POSES, (-1, 4, 4), says="their poses as re-estimated now, each 4×4 row by row")
    ]
    rejected_ids: Annotated[NDArray[np.int64], About(Kind.TRACKS)] = field(default_factory=_no_ids)
    ended_ids: Annotated[NDArray[np.int64], About(Kind.TRACKS)] = field(default_factory=_no_ids)
    ended_points_in_world: Annotated[Array, About(Kind.POINTS)] = field(default_factory=lambda: np.empty((0, 3)))
    ended_cov_points_in_world: Annotated[Array, About(Kind.COV_POINTS, of="ended_points_in_world")] = field(
        default_factory=lambda: np.empty((0, 3, 3))
    )
    iterations: int = 0
    nis: Annotated[float, About(says="whitened squared innovation of the accepted views")] = 0.0
    nis_dof: Annotated[
        int, About(says="its degrees of freedom; nis/nis_dof is 1 where the noise is as assumed")
    ] = 0
    rig: RigEstimate | None = None
    relative: Annotated[RelativeMotions | None, About(Kind.PARTS)] = None
    common: Annotated[CommonErrors | None, About(Kind.PARTS)] = None
    inertial: InertialEstimate | None = None

    def __repr__(self) -> str:
        pose = _pose(self.world_from_cam, self.cov_pose)
        return f"<Solution {self.status} {pose}, {len(self.track_ids)} points>"


class Estimator(Protocol):
    """Takes the observations of each frame and returns a Solution; the contract of every method.

    The world is the camera of the first frame. A frame with too few views is answered with status lost and a
    predicted pose; the next frame with enough points starts a new map from there.
    """

    name: str

    def step(self, observations: Observations) -> Solution:
        """Return the solution of the next frame; frames come in order."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Prediction:
    """Where the camera is at `stamp_ns` by inertial samples since the latest frame.

    `world_from_cam` (4, 4) with `cov_pose` (6, 6), as in a FrameEstimate; `inertial`: velocity, gravity and all else.
    """

    stamp_ns: int
    world_from_cam: Array
    cov_pose: Array
    inertial: InertialEstimate

    def __repr__(self) -> str:
        return f"<Prediction at {self.stamp_ns} ns {_pose(self.world_from_cam, self.cov_pose)}>"


@runtime_checkable
class InertialEstimator(Protocol):
    """An estimator that uses inertial samples, and predicts the camera's motion by them."""

    @property
    def inertial_problem(self) -> str:
        """Why samples that have come are not used; empty where they are."""

    def expect(self, stamp_ns: int, view: InertialView | None) -> ExpectedMotion | None:
        """Return the motion since the latest estimate up to a stamp, with the samples that come with that frame."""

    def predict(self, stamp_ns: int, view: InertialView | None) -> Prediction | None:
        """Return pose and state later on, with further samples, which are not kept; None where none lead there."""


def expected_motion(estimator: object, stamp_ns: int, view: InertialView) -> ExpectedMotion | None:
    """Return the motion that an estimator predicts for the next frame; None of one that takes no inertial samples."""
    return estimator.expect(stamp_ns, view) if isinstance(estimator, InertialEstimator) else None


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class FrameEstimate(Solution):
    """The result for one frame: a `Solution` in the axes of the physical left camera, lengths in metres.

    Beyond the fields of a `Solution` it has

    - `frame_index` from 0, and `stamp_ns`.
    - `counts`: points tracked, new, used, rejected.
    - `timings_ms`: milliseconds per stage, the only field that differs between two runs on one log.
    - `unscaled`: made with one camera; lengths are in units of the first baseline instead of metres.
    - `rig_change`: set in the frame that detects a turn of the right camera, some frames after the turn.
    """

    frame_index: Annotated[
        int, About(Kind.FRAMES, says="counts the frames given to the engine, from 0", column=True)
    ]
    stamp_ns: Annotated[int, About(says="stamp of the left image, nanoseconds", column=True)]
    counts: dict[str, int]
    timings_ms: dict[str, float]
    unscaled: Annotated[
        bool, About(says="with one camera: lengths are in units of the first baseline, not in metres")
    ] = False
    rig_change: Annotated[RigChange | None, About(Kind.PARTS)] = None

    def upright(self, fixed_from_world: Array = BODY_FROM_CAMERA_AXES) -> Upright | None:
        """Return where the world lies in one whose z axis is up, by the gravity of this frame; None without inertia.

        `upright_from_world @ world_from_cam` is the pose there, with `cov_pose`. `fixed_from_world` (4, 4): the axes to
        make upright; those of a body, x forward and y left, if not given.
        """
        if self.inertial is None:
            return None
        joint = self.inertial.cov[np.ix_(_POSE_AND_GRAVITY, _POSE_AND_GRAVITY)].copy()
        joint[:6, :6] = self.cov_pose  # where a map began anew in the same world, that of its place is in it, too
        return Upright.of(self.world_from_cam, self.inertial.gravity, joint, fixed_from_world)

    def __repr__(self) -> str:
        pose = _pose(self.world_from_cam, self.cov_pose, "units" if self.unscaled else "m")
        return f"<FrameEstimate {self.frame_index} {self.status} {pose}, {len(self.track_ids)} points>"


class Sink(Protocol):
    """Watches a run frame by frame: a file, a viewer, a progress bar, a queue."""

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Take the estimate of the next frame, and the frame it was made from."""

    def close(self) -> None:
        """Finish: no more frames will come."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Trajectory:
    """Poses over time: `stamps_ns` (n,) int64, ascending; `world_from_cam` (n, 4, 4); `cov_pose` (n, 6, 6) or None."""

    stamps_ns: NDArray[np.int64]
    world_from_cam: Array
    cov_pose: Array | None = None

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __repr__(self) -> str:
        duration_s = (self.stamps_ns[-1] - self.stamps_ns[0]) / 1e9 if len(self) else 0.0
        return f"<Trajectory {len(self)} poses in {duration_s:.2f} s>"


def _size(image: Image) -> str:
    """Width × height of an image; the type of anything else, which only an engine refuses."""
    shape = getattr(image, "shape", ())
    return "×".join(map(str, [*shape[1::-1], *shape[2:]])) if len(shape) > 1 else type(image).__name__


def _pose(world_from_cam: Array, cov_pose: Array, unit: str = "m") -> str:
    """Position and its σ, the square root of the trace of its covariance."""
    x, y, z = world_from_cam[:3, 3]
    return f"t=({x:.3f}, {y:.3f}, {z:.3f}) {unit} σ={np.sqrt(np.trace(cov_pose[:3, :3])):.2g} {unit}"
