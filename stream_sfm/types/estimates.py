"""The results of estimators: solutions in rectified axes, and the estimates of frames for users."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array
from ..geometry.linear import Cholesky
from ..inertial.state import GRAVITY
from ..inertial.upright import BODY_FROM_CAMERA_AXES, Upright
from ..record import About, Kind, record
from ..rig_model.estimate import RigEstimate
from .observations import RigChange

_POSE_AND_GRAVITY = [*range(6), *range(6 + GRAVITY.start, 6 + GRAVITY.stop)]  # rows of `InertialEstimate.cov`


class Status(StrEnum):
    """How far the estimate of a frame can be trusted; `FrameEstimate.reason` gives the reason."""

    INITIALISING = "initialising"  # the first frame of a map; its pose is known by definition or by prediction
    OK = "ok"
    DEGRADED = "degraded"  # estimated from few or badly distributed points, or from faulty images
    LOST = "lost"  # predicted only; the covariance grows accordingly


@record
class InertialEstimate:
    """The inertial state of a frame, in axes of the camera; SI and radians.

    `velocity` (3,); `gravity` (3,): the acceleration of a falling body; `gyro_bias` (3,), `accel_bias` (3,), in
    axes of the unit; `scale`: the share by which lengths from images alone are too short, already corrected;
    `axes_rad` (3,): rotation of the unit relative to its calibration; `time_offset_s`: beyond the calibrated one.
    `cov` (23, 23): joint covariance of the pose perturbation (6), then these 17 in order. `densities` (2,): learnt
    factors on the noise densities of gyroscope and accelerometer. `distance2`: squared distance of the motion from
    images to that from samples, 6 expected. `dead_reckoned`: the pose comes from samples alone. `note`: what is
    wrong with the samples.
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
        return f"<InertialEstimate {np.linalg.norm(self.velocity):.2f} m/s, tilt ±{1e3 * self.std_tilt_rad:.1f} mrad>"


def _no_ids() -> NDArray[np.int64]:
    return np.empty(0, dtype=np.int64)


@record
class RelativeMotions:
    """Motions between the newest frame and earlier ones (r), each with its covariance.

    `frame_indices` (r,); `frame_from_newest` (r, 4, 4) carries points of the newest camera into the earlier one;
    `cov` (r, 6, 6) of the perturbation on its right, translation first: metres², radians². `common_jacobian`
    (r, 6, m): the effect of each of the `CommonErrors` of the frame on this perturbation; None if these are.
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


@record
class CommonErrors:
    """Errors c (m,) that all poses and motions of a run have in common, so that no number of frames averages them out.

    The first are those that no view shows: of all lengths, and of the camera's axes about its x and y. Then come
    the physical terms of the rig (in a Solution all terms of the rig, and only these). Each is in units of its
    prior σ. This frame was estimated with c = `mean` (m,), whose covariance is `cov` (m, m). `jacobian` (6, m):
    truth = world_from_cam·Exp(jacobian (c − mean) + own), where `own` has the covariance cov_pose − jacobian cov
    jacobianᵀ; the same holds for the motions of `RelativeMotions`, eq. (74a). c is valid for all frames from
    `since` on: if a camera is knocked, or the calibration of the log changes, a new c begins.
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
        known = self.cov[:n, :n] + 1e-9 * np.eye(n)  # invertible, even if an error is known exactly
        return np.concatenate([np.eye(n), Cholesky(known).solve(self.cov[:n, n:]).T])

    def __repr__(self) -> str:
        return f"<CommonErrors {len(self.mean)} terms>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Solution:
    """The result of an estimator for one frame, in the axes of the rectified left camera; lengths in metres.

    - `status`, and `reason`: why the status is not ok.
    - `world_from_cam` (4, 4): the pose; the world is the left camera of the first frame. `cov_pose` (6, 6): of the
      perturbation on its right, translation first; metres², radians².
    - `track_ids` (n,), `points_in_cam` (n, 3), `cov_points` (n, 3, 3): the local structure, points seen now in
      camera axes; `points_in_world`, `cov_points_in_world`: the same points in the world.
    - `ended_ids` (k,), `ended_points_in_world` (k, 3), `ended_cov_points_in_world` (k, 3, 3): final estimates of
      the points that left the estimator with this frame.
    - `window_frame_indices` (b,), `window_world_from_cam` (b, 4, 4): all poses of the window, the oldest first.
    - `rejected_ids`: points whose views in this frame were judged to be outliers. `iterations`: those of the
      solver.
    - `nis`, `nis_dof`: whitened squared innovation of the accepted views, and its degrees of freedom.
    - `rig`: the estimated errors of the calibration; None if it is taken as exact.
    - `relative`: the motions between this frame and those of the window, for fusion. None if the method has no joint
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
    nis_dof: Annotated[int, About(says="its degrees of freedom; nis/nis_dof is 1 where the noise is as assumed")] = 0
    rig: RigEstimate | None = None
    relative: Annotated[RelativeMotions | None, About(Kind.PARTS)] = None
    common: Annotated[CommonErrors | None, About(Kind.PARTS)] = None
    inertial: InertialEstimate | None = None

    def __repr__(self) -> str:
        pose = _pose(self.world_from_cam, self.cov_pose)
        return f"<Solution {self.status} {pose}, {len(self.track_ids)} points>"


@record
class Prediction:
    """Where inertial samples since the latest frame put the camera at `stamp_ns`.

    `world_from_cam` (4, 4) with `cov_pose` (6, 6), as in a FrameEstimate; `inertial`: velocity, gravity and the rest.
    """

    stamp_ns: int
    world_from_cam: Array
    cov_pose: Array
    inertial: InertialEstimate

    def __repr__(self) -> str:
        return f"<Prediction at {self.stamp_ns} ns {_pose(self.world_from_cam, self.cov_pose)}>"


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

    frame_index: Annotated[int, About(Kind.FRAMES, says="counts the frames given to the engine, from 0", column=True)]
    stamp_ns: Annotated[int, About(says="stamp of the left image, nanoseconds", column=True)]
    counts: dict[str, int]
    timings_ms: dict[str, float]
    unscaled: Annotated[
        bool, About(says="with one camera: lengths are in units of the first baseline, not in metres")
    ] = False
    rig_change: Annotated[RigChange | None, About(Kind.PARTS)] = None

    def upright(self, fixed_from_world: Array = BODY_FROM_CAMERA_AXES) -> Upright | None:
        """Return the world in axes whose z is up, by the gravity of this frame; None without inertial samples.

        `upright_from_world @ world_from_cam` is the pose there, with `cov_pose`. `fixed_from_world` (4, 4): the axes to
        make upright; by default those of a body, x forward and y left.
        """
        if self.inertial is None:
            return None
        joint = self.inertial.cov[np.ix_(_POSE_AND_GRAVITY, _POSE_AND_GRAVITY)].copy()
        joint[:6, :6] = self.cov_pose  # includes the place of a new map in the same world
        return Upright.of(self.world_from_cam, self.inertial.gravity, joint, fixed_from_world)

    def __repr__(self) -> str:
        pose = _pose(self.world_from_cam, self.cov_pose, "units" if self.unscaled else "m")
        return f"<FrameEstimate {self.frame_index} {self.status} {pose}, {len(self.track_ids)} points>"


@record
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


def _pose(world_from_cam: Array, cov_pose: Array, unit: str = "m") -> str:
    """Return the position and its σ, the square root of the trace of its covariance."""
    x, y, z = world_from_cam[:3, 3]
    return f"t=({x:.3f}, {y:.3f}, {z:.3f}) {unit} σ={np.sqrt(np.trace(cov_pose[:3, :3])):.2g} {unit}"
