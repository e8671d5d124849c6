"""The frozen records that travel between rooms. Arrays are float64 unless said, and never written to."""

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .errors import ConfigError
from .geometry import pose as se3
from .geometry.pose import Array

MAX_PIXELS = 2**25  # of an image: more is a damaged header, or hostile
DISTORTION_COEFFICIENTS = {
    "none": (0,),
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (8,),
    "equidistant": (4,),
}


class Status(StrEnum):
    """What the estimate of a frame is worth; `FrameEstimate.reason` says why."""

    INITIALISING = "initialising"  # the first frame of a (new) map: pose by definition or by prediction
    OK = "ok"
    DEGRADED = "degraded"  # estimated, but from few or badly placed points
    LOST = "lost"  # predicted only; the covariance says how much that is worth


@dataclass(frozen=True, slots=True)
class Camera:
    """One pinhole camera as delivered, before rectification.

    `K` (3, 3) pixels; `D` distortion coefficients in OpenCV's order; `distortion_model` one of none, plumb_bob
    (4 or 5), rational_polynomial (8), equidistant (4). Raises ConfigError for the impossible.
    """

    width: int
    height: int
    K: Array
    D: tuple[float, ...] = ()
    distortion_model: str = "plumb_bob"

    def __post_init__(self) -> None:
        k = np.array(self.K, dtype=float)
        d = tuple(float(x) for x in np.ravel(np.asarray(self.D, dtype=float)))
        object.__setattr__(self, "K", k)
        object.__setattr__(self, "D", d)
        if self.width < 16 or self.height < 16 or self.width * self.height > MAX_PIXELS:
            raise ConfigError(
                f"camera size {self.width}×{self.height}: give width and height in pixels, each at least 16, "
                f"together at most {MAX_PIXELS / 1e6:.0f} megapixels"
            )
        if k.shape != (3, 3) or not np.isfinite(k).all():
            raise ConfigError(f"camera matrix K must be 3×3 and finite, got shape {k.shape}: {k.tolist()}")
        if k[0, 0] <= 0 or k[1, 1] <= 0 or not np.allclose(k[2], (0, 0, 1)):
            raise ConfigError(
                f"camera matrix K must have fx, fy > 0 and last row 0 0 1, got {k.tolist()}: "
                "is the camera calibrated?"
            )
        allowed = DISTORTION_COEFFICIENTS.get(self.distortion_model)
        if allowed is None:
            names = ", ".join(DISTORTION_COEFFICIENTS)
            raise ConfigError(f"distortion model {self.distortion_model!r} is not known; known are {names}")
        if not np.isfinite(d).all() or (any(d) and len(d) not in allowed):
            raise ConfigError(
                f"distortion model {self.distortion_model} takes {allowed} finite coefficients, got {list(d)}"
            )


@dataclass(frozen=True, slots=True)
class StereoRig:
    """Two cameras and `right_from_left` (4, 4), metres: carries points of the left camera into the right one.

    Raises ConfigError where the pair cannot be a stereo pair.
    """

    left: Camera
    right: Camera
    right_from_left: Array

    def __post_init__(self) -> None:
        pose = np.array(self.right_from_left, dtype=float)
        if pose.shape != (4, 4) or not (np.abs(pose) < 1e6).all():  # false for NaN too
            raise ConfigError(f"right_from_left must be a 4×4 pose in metres, got {pose.tolist()}")
        r = pose[:3, :3]
        if not np.allclose(r @ r.T, np.eye(3), atol=1e-3) or np.linalg.det(r) < 0:
            raise ConfigError(f"right_from_left holds no rotation: {r.tolist()}")
        object.__setattr__(self, "right_from_left", se3.orthonormalised(pose))
        if (self.left.width, self.left.height) != (self.right.width, self.right.height):
            raise ConfigError(
                f"left images are {self.left.width}×{self.left.height}, right ones "
                f"{self.right.width}×{self.right.height}: both must have one size"
            )
        if self.baseline_m < 1e-4:
            raise ConfigError(
                f"the baseline is {self.baseline_m:g} m: give right_from_left in metres; in a ROS calibration it "
                "is −P[3]/P[0] of the right camera, which must not be zero"
            )

    @property
    def cameras(self) -> dict[str, Camera]:
        """Name -> camera, in the order of a frame's images."""
        return {"left": self.left, "right": self.right}

    @property
    def baseline_m(self) -> float:
        """Distance between the two camera centres, metres."""
        return float(np.linalg.norm(self.right_from_left[:3, 3]))

    @classmethod
    def from_calibration(cls, path: str | Path) -> "StereoRig":
        """Read a calibration file (TOML; its format is in the README). Raises ConfigError."""
        from .calibration import read_calibration

        return read_calibration(path)


@dataclass(frozen=True, slots=True)
class MonoRig:
    """One camera: the scale of what it sees is not observable (`Config.mono`)."""

    left: Camera

    @property
    def cameras(self) -> dict[str, Camera]:
        """As in StereoRig."""
        return {"left": self.left}

    @classmethod
    def from_calibration(cls, path: str | Path) -> "MonoRig":
        """The left camera of a calibration file, which needs no other section. Raises ConfigError."""
        from .calibration import read_camera

        return read_camera(path)


@dataclass(frozen=True, slots=True)
class StereoFrame:
    """One pair of images of the same moment, (h, w) uint8, as the cameras deliver them; `stamp_ns` integer."""

    stamp_ns: int
    left: NDArray[np.uint8]
    right: NDArray[np.uint8]

    @property
    def images(self) -> tuple[NDArray[np.uint8], ...]:
        """Both images."""
        return self.left, self.right


@dataclass(frozen=True, slots=True)
class MonoFrame:
    """One image (h, w) uint8 of a camera that has no partner; `stamp_ns` integer."""

    stamp_ns: int
    left: NDArray[np.uint8]

    @property
    def images(self) -> tuple[NDArray[np.uint8], ...]:
        """The one image."""
        return (self.left,)


@dataclass(frozen=True, slots=True)
class MapStart:
    """One camera: all that the front-end knows of a frame's depths, from which a map can begin there.

    `z_px` (n, 4), `cov_px` (n, 4, 4): the frame's views with right sides pretended from those depths.
    `first_from_cam` (4, 4), `cov_first_from_cam` (6, 6): the motion since the frame whose distance is the unit.
    """

    z_px: Array
    cov_px: Array
    first_from_cam: Array
    cov_first_from_cam: Array


@dataclass(frozen=True, slots=True)
class Observations:
    """What the front-end saw in one frame, in pixels of the rectified pair.

    `track_ids` (n,) int64, unique, ascending: a point keeps its id while it is tracked; an id that is missing
    in one frame never comes back. `z_px` (n, 4) = (u_left, v_left, u_right, v_right), the right side NaN where
    it was not found; the first view of an id has both sides. `cov_px` (n, 4, 4). `cam_from_previous` (4, 4) the
    front-end's own robust motion since the previous frame, a start value only, or None. `note` says what the
    front-end met ("image is black"), empty when nothing. `n_new` of the ids are new. `std_drift_px` (n,): how far
    the patch may have slid over its surface since the previous frame, for patches seen from a changing direction;
    None where points are points. `start`: of one camera, where it knows depths.
    """

    frame_index: int
    stamp_ns: int
    track_ids: NDArray[np.int64]
    z_px: Array
    cov_px: Array
    cam_from_previous: Array | None = None
    note: str = ""
    n_new: int = 0
    std_drift_px: Array | None = None
    start: MapStart | None = None


def _no_ids() -> NDArray[np.int64]:
    return np.empty(0, dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Solution:
    """What an estimator says after one frame, in rectified camera axes.

    `world_from_cam` (4, 4), `cov_pose` (6, 6) of the right perturbation, translation first. CC local structure:
    `points_in_cam` (n, 3) m, `cov_points` (n, 3, 3) m² of the points seen now, `track_ids` (n,). WC structure:
    `points_in_world`, `cov_points_in_world`, same rows; `ended_*` are points that left the estimator with this
    frame, final (ids (k,), points in world (k, 3), covariances (k, 3, 3)).
    `window_world_from_cam` (b, 4, 4): all frames of the window, oldest first, with `window_frame_indices` (b,).
    `rejected_ids`: views of this frame judged to be outliers. `nis`, `nis_dof`: whitened squared innovation of
    the accepted views and its degrees of freedom.
    """

    status: Status
    reason: str
    world_from_cam: Array
    cov_pose: Array
    track_ids: NDArray[np.int64]
    points_in_cam: Array
    cov_points: Array
    points_in_world: Array
    cov_points_in_world: Array
    window_frame_indices: NDArray[np.int64]
    window_world_from_cam: Array
    rejected_ids: NDArray[np.int64] = field(default_factory=_no_ids)
    ended_ids: NDArray[np.int64] = field(default_factory=_no_ids)
    ended_points_in_world: Array = field(default_factory=lambda: np.empty((0, 3)))
    ended_cov_points_in_world: Array = field(default_factory=lambda: np.empty((0, 3, 3)))
    iterations: int = 0
    nis: float = 0.0
    nis_dof: int = 0


class Estimator(Protocol):
    """Observations in, one Solution a frame out; every method of the package keeps this contract.

    The first frame's camera is the world. A frame with too few views is answered with status lost and a
    predicted pose; the next frame with enough points starts a new map from there.
    """

    name: str

    def step(self, observations: Observations) -> Solution:
        """Take the next frame; frames come in order."""
        ...


@dataclass(frozen=True, slots=True)
class FrameEstimate:
    """The result of one frame, in axes of the physical left camera. Names and shapes as in `Solution`.

    `counts`: tracked, new, used, rejected. `timings_ms`: stage -> milliseconds (the only field that differs
    between two runs of one log). `unscaled`: of one camera; for metres read its first baseline, everywhere.
    """

    frame_index: int
    stamp_ns: int
    status: Status
    reason: str
    world_from_cam: Array
    cov_pose: Array
    track_ids: NDArray[np.int64]
    points_in_cam: Array
    cov_points: Array
    points_in_world: Array
    cov_points_in_world: Array
    window_frame_indices: NDArray[np.int64]
    window_world_from_cam: Array
    ended_ids: NDArray[np.int64]
    ended_points_in_world: Array
    ended_cov_points_in_world: Array
    counts: dict[str, int]
    nis: float
    nis_dof: int
    timings_ms: dict[str, float]
    unscaled: bool = False


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses in time: `stamps_ns` (n,) int64 ascending, `world_from_cam` (n, 4, 4), `cov_pose` (n, 6, 6) or None."""

    stamps_ns: NDArray[np.int64]
    world_from_cam: Array
    cov_pose: Array | None = None

    def __len__(self) -> int:
        return len(self.stamps_ns)
