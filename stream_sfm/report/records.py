"""What a comparison records of each frame for its report: small numbers, and a few small images."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..camera.rig import StereoRig
from ..config import Config
from ..evaluation.relative_consistency import RelativeRecord
from ..evaluation.structure import StructureComparison
from ..geometry.se3 import Array
from ..types import FrameEstimate, Observations, Trajectory

MAX_SNAPSHOTS = 6  # kept, of which three are shown; a report stays below a few megabytes


@dataclass(slots=True, eq=False, repr=False)
class MethodRun:
    """The results of one method; a list has one entry per frame unless stated otherwise.

    `reprojection_px`: RMS over the views used; `depth_rows`: (frame, RMS depth error, RMS estimated σ), for frames
    with a depth image; `sigma_local_m`: median estimated σ of the local points along their viewing rays; `back`:
    poses of the reversed pass, from the last but one frame to the first; `failure`: why the method stopped early.
    """

    name: str
    structure: StructureComparison | None = None
    relative: RelativeRecord = field(default_factory=RelativeRecord)
    stamps_ns: list[int] = field(default_factory=list)
    poses: list[Array] = field(default_factory=list)
    covs: list[Array] = field(default_factory=list)
    statuses: list[str] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    used: list[int] = field(default_factory=list)
    rejected: list[int] = field(default_factory=list)
    nis: list[float] = field(default_factory=list)
    nis_dof: list[int] = field(default_factory=list)
    estimator_ms: list[float] = field(default_factory=list)
    reprojection_px: list[float] = field(default_factory=list)
    sigma_local_m: list[float] = field(default_factory=list)
    depth_rows: list[tuple[int, float, float]] = field(default_factory=list)
    back: list[Array] = field(default_factory=list)
    failure: str = ""

    @property
    def key(self) -> str:
        """The name of the method as a JSON key."""
        return self.name.replace("-", "_")

    def add(self, estimate: FrameEstimate) -> None:
        """Record what the report shows of one frame."""
        self.stamps_ns.append(estimate.stamp_ns)
        self.poses.append(estimate.world_from_cam)
        self.covs.append(estimate.cov_pose)
        self.statuses.append(str(estimate.status))
        self.reasons.append(estimate.reason)
        self.used.append(estimate.counts["used"])
        self.rejected.append(estimate.counts["rejected"])
        self.nis.append(estimate.nis)
        self.nis_dof.append(estimate.nis_dof)
        self.estimator_ms.append(estimate.timings_ms["estimator"])
        self.sigma_local_m.append(_median_sigma(estimate))
        self.relative.add(estimate)

    def trajectory(self) -> Trajectory:
        """All poses with their covariances."""
        n = len(self.poses)
        return Trajectory(
            np.array(self.stamps_ns, np.int64),
            np.array(self.poses).reshape(n, 4, 4),
            np.array(self.covs).reshape(n, 6, 6),
        )


def _median_sigma(estimate: FrameEstimate) -> float:
    points = estimate.points_in_cam
    if not len(points):
        return float("nan")
    rays = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9)
    variance = np.einsum("ni,nij,nj->n", rays, estimate.cov_points, rays)
    return float(np.sqrt(np.median(np.maximum(variance, 0))))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Snapshot:
    """A stereo frame as small JPEGs of the rectified images, with displacements in full-size pixels.

    `stereo` (n, 4) u_left, v_left, u_right, v_right; `temporal` (m, 4) from (u, v) in the previous frame to now.
    """

    frame_index: int
    size: tuple[int, int]
    left_jpeg: bytes
    right_jpeg: bytes
    stereo: Array
    temporal: Array


@dataclass(slots=True, eq=False, repr=False)
class FrontRecord:
    """What all methods share: observations and times, one entry per frame unless stated otherwise.

    `lives`: track id -> [first frame, last frame]; `gaps`: frames that follow a gap in time.
    """

    decode_ms: list[float] = field(default_factory=list)
    rectify_ms: list[float] = field(default_factory=list)
    frontend_ms: list[float] = field(default_factory=list)
    tracked: list[int] = field(default_factory=list)
    new: list[int] = field(default_factory=list)
    lives: dict[int, list[int]] = field(default_factory=dict)
    snapshots: list[Snapshot] = field(default_factory=list)
    snapshot_stride: int = 1
    gaps: list[int] = field(default_factory=list)

    def add(self, observations: Observations) -> None:
        """Record the observations of one frame."""
        frame = observations.frame_index
        self.tracked.append(len(observations.track_ids) - observations.n_new)
        self.new.append(observations.n_new)
        for track in observations.track_ids.tolist():
            self.lives.setdefault(track, [frame, frame])[1] = frame

    def wants_snapshot(self, frame_index: int) -> bool:
        """Whether this frame is one of the few that are shown, evenly spread over a log of any length."""
        return frame_index % self.snapshot_stride == 0

    def keep(self, snapshot: Snapshot) -> None:
        """Add a snapshot; when there are too many, every second one is dropped and the stride doubles."""
        self.snapshots.append(snapshot)
        if len(self.snapshots) > MAX_SNAPSHOTS:
            self.snapshots = self.snapshots[::2]
            self.snapshot_stride *= 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CalibrationError:
    """What the images have told about the calibration: `numbers` as the section `rig` of summary.json.

    `disparity_px` (rows, columns): the error of the disparity of far points over the left image, with `std_px`.
    """

    numbers: dict[str, Any]
    disparity_px: Array
    std_px: Array


@dataclass(slots=True, eq=False, repr=False)
class Comparison:
    """Everything that a report is made from.

    `inspection` as `inspect_log` returns it, or empty; `local_difference`: (frame, median distance between CC and
    WC-derived local points, metres); `return_note`: whether the frames were also processed in reverse order, or why
    not; `ignored`: ranges [first, end) of frames without their truth;
    `self_test`: the result of that, if it was done; `std_truth`: σ of the ground truth itself, metres and radians;
    `calibration`: what the cross-frame window has found about that.
    """

    log: str
    rig: StereoRig
    config: Config
    runs: list[MethodRun]
    front: FrontRecord
    truth: Trajectory | None
    inspection: dict[str, Any]
    local_difference: list[tuple[int, float]] = field(default_factory=list)
    ignored: list[tuple[int, int]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    complete: bool = True
    interrupted: bool = False
    return_note: str = ""
    self_test: dict[str, list[dict[str, Any]]] | None = None
    std_truth: tuple[float, float] = (0.0, 0.0)
    calibration: CalibrationError | None = None
