"""The frozen records that travel between rooms, and the protocols of what they travel through.

Arrays are float64 unless said, and never written to. A record is equal to itself only, for arrays have no truth value,
and its `repr` is one short line.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .errors import ConfigError
from .geometry.se3 import Array

Picture = NDArray[np.uint8] | bytes  # (h, w) grey values, or a compressed image (PNG, JPEG, WebP)


class Status(StrEnum):
    """What the estimate of a frame is worth; `FrameEstimate.reason` says why."""

    INITIALISING = "initialising"  # the first frame of a (new) map: pose by definition or by prediction
    OK = "ok"
    DEGRADED = "degraded"  # estimated, but from few or badly placed points
    LOST = "lost"  # predicted only; the covariance says how much that is worth


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StereoFrame:
    """One pair of images of the same moment, (h, w) uint8, as the cameras deliver them; `stamp_ns` integer.

    `pictures`: the same images for a viewer, where they came compressed and need not be compressed again.
    """

    stamp_ns: int
    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    pictures: tuple[Picture, ...] = ()

    @property
    def images(self) -> tuple[NDArray[np.uint8], ...]:
        """Both images."""
        return self.left, self.right

    def __repr__(self) -> str:
        return f"<StereoFrame at {self.stamp_ns} ns, {_size(self.left)} and {_size(self.right)}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MonoFrame:
    """One image (h, w) uint8 of a camera that has no partner; the rest as in StereoFrame."""

    stamp_ns: int
    left: NDArray[np.uint8]
    pictures: tuple[Picture, ...] = ()

    @property
    def images(self) -> tuple[NDArray[np.uint8], ...]:
        """The one image."""
        return (self.left,)

    def __repr__(self) -> str:
        return f"<MonoFrame at {self.stamp_ns} ns, {_size(self.left)}>"


Frame = StereoFrame | MonoFrame


@dataclass(frozen=True, slots=True)
class Selection:
    """Which frames of a log are used; without arguments all of them.

    `start_s`, `end_s`: seconds from the first frame, both included; `stride`: every N-th frame of those; `max_frames`:
    at most so many of the rest. Raises ConfigError for a selection that no frame can be in.
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
        """How many of so many frames are used; None where that is not known, without their times for instance."""
        if self.start_s is not None or self.end_s is not None or frames is None:
            return self.max_frames
        used = -(-frames // self.stride)
        return used if self.max_frames is None else min(used, self.max_frames)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MapStart:
    """One camera: all that the front-end knows of a frame's depths, from which a map can begin there.

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

    def __repr__(self) -> str:
        note = f", {self.note}" if self.note else ""
        return f"<Observations {self.frame_index} {len(self.track_ids)} points, {self.n_new} new{note}>"


def _no_ids() -> NDArray[np.int64]:
    return np.empty(0, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
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

    def __repr__(self) -> str:
        pose = _pose(self.world_from_cam, self.cov_pose)
        return f"<Solution {self.status} {pose}, {len(self.track_ids)} points>"


class Estimator(Protocol):
    """Observations in, one Solution a frame out; every method of the package keeps this contract.

    The first frame's camera is the world. A frame with too few views is answered with status lost and a
    predicted pose; the next frame with enough points starts a new map from there.
    """

    name: str

    def step(self, observations: Observations) -> Solution:
        """Take the next frame; frames come in order."""
        ...


@dataclass(frozen=True, slots=True, eq=False, repr=False)
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

    def __repr__(self) -> str:
        pose = _pose(self.world_from_cam, self.cov_pose, "units" if self.unscaled else "m")
        return f"<FrameEstimate {self.frame_index} {self.status} {pose}, {len(self.track_ids)} points>"


class Sink(Protocol):
    """Watches a run frame by frame: files, a viewer, a progress bar, a queue."""

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Take the estimate of the next frame, and the frame itself."""
        ...

    def close(self) -> None:
        """No more will come."""
        ...


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Trajectory:
    """Poses in time: `stamps_ns` (n,) int64 ascending, `world_from_cam` (n, 4, 4), `cov_pose` (n, 6, 6) or None."""

    stamps_ns: NDArray[np.int64]
    world_from_cam: Array
    cov_pose: Array | None = None

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __repr__(self) -> str:
        duration_s = (self.stamps_ns[-1] - self.stamps_ns[0]) / 1e9 if len(self) else 0.0
        return f"<Trajectory {len(self)} poses in {duration_s:.2f} s>"


def _size(image: NDArray[np.uint8]) -> str:
    """Width × height; the type of what is no image, for a frame can be made of anything until an engine meets it."""
    shape = getattr(image, "shape", ())
    return "×".join(map(str, [*shape[1::-1], *shape[2:]])) if len(shape) > 1 else type(image).__name__


def _pose(world_from_cam: Array, cov_pose: Array, unit: str = "m") -> str:
    """Position, and the σ of it: the square root of the trace of its covariance."""
    x, y, z = world_from_cam[:3, 3]
    return f"t=({x:.3f}, {y:.3f}, {z:.3f}) {unit} σ={np.sqrt(np.trace(cov_pose[:3, :3])):.2g} {unit}"
