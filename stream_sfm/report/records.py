"""The record of a run, frame by frame, of each method and of what all methods share, for summary and pages."""

from array import array
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera.refinement import disparity_rms_px
from ..camera.rig import StereoRig
from ..config import Config
from ..errors import FrameError
from ..evaluation.figures import NIS, TIME, Figure
from ..evaluation.relative_consistency import RelativeRecord
from ..evaluation.structure import StructureComparison
from ..evaluation.trajectory import path_length_m
from ..geometry import Array
from ..geometry.medians import median as median_of_finite
from ..inertial.upright import Upright
from ..logs.recording.pairing import gaps_after
from ..methods import REFERENCE, key_of
from ..motion import Odometry
from ..pipeline.observer import Observed
from ..rig_model.estimate import RigEstimate
from ..system.wording import counted
from ..types import FrameEstimate, InertialEstimate, RigChange, Status, Trajectory
from .inertia import describe_inertia

if TYPE_CHECKING:
    from .matches import Needles

STAGES = ("decode", "frontend", "estimator", "total")
_OF_ESTIMATE = ("nis", "nis_dof")  # numbers of each frame that are in its estimate
_NUMBERS = (*STAGES, "sigma_local_m", "reprojection_px", *_OF_ESTIMATE)
_POSE, _COV = slice(0, 16), slice(16, 52)  # places in the row of a frame, before the numbers
_WIDTH = _COV.stop + len(_NUMBERS)
# In frames; real calibrations are corrected within the first two or three, with little effect on the poses.
_AT_THE_START = 10
NO_LOOPS: Array = np.zeros((0, 2, 3))


class RunRecord:
    """The record of one method, some 1500 bytes per frame. Columns and arrays have one row per frame.

    `statuses` and their `reasons`; `depth_rows`: (frame, RMS depth error, RMS estimated σ) of the frames with a
    depth image, and `structure` their total, None if a depth image could not be read; `failure`: why the method
    stopped early; `rig`: the latest estimate of the calibration errors, in pixels; `unit`: of the inertial unit.
    """

    def __init__(self, name: str, disparity_at_1m_px: float = 1.0) -> None:
        """`disparity_at_1m_px`: focal length times baseline."""
        self.name, self._disparity_at_1m_px = name, disparity_at_1m_px
        self.failure = ""
        self.refused = 0
        self.first_refusal: FrameError | None = None
        self.statuses: list[Status] = []
        self.reasons: list[str] = []
        self.depth_rows: list[tuple[int, float, float]] = []
        self.structure: StructureComparison | None = None
        self.relative = RelativeRecord()
        self.rig: RigEstimate | None = None
        self.unit: InertialEstimate | None = None  # the one of the latest frame that has it
        self.upright: Upright | None = None  # the orientation of the world by that frame
        self.inertial_problem = ""  # why samples were not used
        self._inertial_frames = self._dead_reckoned = 0
        self.rig_changes: list[RigChange] = []
        self._corrected_from: tuple[int, RigEstimate] | None = None  # the first frame, and what was corrected in it
        self._stamps_ns, self._rows = array("q"), array("d")

    @property
    def key(self) -> str:
        """The name of the method as a JSON key."""
        return key_of(self.name)

    def add(
        self, estimate: FrameEstimate, total_ms: float = 0.0, of_points: tuple[float, float] = (np.nan, np.nan)
    ) -> None:
        """Add one estimate; `total_ms`: from the request for the frame until its files were written.

        `of_points`: the median σ of the points along their rays, metres, and the RMS reprojection error, pixels.
        """
        self._stamps_ns.append(estimate.stamp_ns)
        self.statuses.append(estimate.status)
        self.reasons.append(estimate.reason)
        t = estimate.timings_ms
        times_ms = (t.get("decode", 0.0), t.get("rectify", 0.0) + t.get("frontend", 0.0), t.get("estimator", 0.0))
        numbers = (*times_ms, total_ms, *of_points, *(getattr(estimate, name) for name in _OF_ESTIMATE))
        row = np.concatenate((estimate.world_from_cam.ravel(), estimate.cov_pose.ravel(), numbers), dtype=float)
        self._rows.frombytes(row.tobytes())
        self.relative.add(estimate)
        self.rig = estimate.rig or self.rig
        if estimate.inertial is not None:
            self._inertial_frames += 1
            self._dead_reckoned += estimate.inertial.dead_reckoned
            self.unit, self.upright = estimate.inertial, estimate.upright()
        if estimate.rig_change is not None:
            self.rig_changes.append(estimate.rig_change)
        if self._corrected_from is None and not self.rig_changes and estimate.rig and estimate.rig.applied:
            self._corrected_from = (estimate.frame_index, estimate.rig)

    def inertial(self) -> dict[str, Any] | None:
        """Return the findings of the run about its inertial unit; None without samples."""
        if self.unit is None or self.upright is None:
            return None
        counts = {"frames": self._inertial_frames, "dead_reckoned": self._dead_reckoned}
        return counts | describe_inertia(self.upright, self.unit)

    def refuse(self, error: FrameError) -> None:
        """Count a frame that the front-end refused."""
        self.refused += 1
        self.first_refusal = self.first_refusal or error

    def __len__(self) -> int:
        return len(self._stamps_ns)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps (n,)."""
        return np.array(self._stamps_ns, np.int64)

    @property
    def poses(self) -> Array:
        """Poses (n, 4, 4), `world_from_cam`."""
        return self._table[:, _POSE].reshape(-1, 4, 4)

    @property
    def _table(self) -> Array:
        return np.array(self._rows).reshape(-1, _WIDTH)

    def column(self, name: str) -> Array:
        """Return one of the numbers of each frame (n,): a stage in ms, or another of `_NUMBERS`."""
        return self._table[:, _COV.stop + _NUMBERS.index(name)]

    @property
    def nis_over_dof(self) -> Array:
        """Squared innovation per degree of freedom (n,); NaN without one."""
        dof = self.column("nis_dof")
        return np.where(dof > 0, self.column("nis") / np.maximum(dof, 1), np.nan)

    def trajectory(self) -> Trajectory:
        """Return all poses with their covariances."""
        return Trajectory(self.stamps_ns, self.poses, self._table[:, _COV].reshape(-1, 6, 6))

    def named(self, name: str) -> "RunRecord":
        """Return the same run under another name."""
        record = copy(self)
        record.name = name
        return record

    def with_poses(self, name: str, trajectory: Trajectory) -> "RunRecord":
        """Return the same run with other poses, and covariances, under another name."""
        record, rows = self.named(name), self._table
        rows[:, _POSE] = trajectory.world_from_cam.reshape(-1, 16)
        rows[:, _COV] = np.asarray(trajectory.cov_pose).reshape(-1, 36)
        record._rows = array("d", rows.tobytes())
        return record

    def count(self, status: Status) -> int:
        """Return how many frames have a status."""
        return self.statuses.count(status)

    def warnings(self) -> list[str]:
        """Return sentences about wrong calibrations, refused, lost and many degraded frames, and early ends."""
        notes = [str(change) for change in self.rig_changes]
        applied = self.rig is not None and self.rig.applied  # until the end: otherwise it was a mistake
        if applied and self._corrected_from is not None and self._corrected_from[0] > _AT_THE_START:
            frame, rig = self._corrected_from
            wrong_px = disparity_rms_px(rig.further)
            notes.append(
                f"from frame {frame} on, a calibration error of {wrong_px:.2f} px of disparity is corrected; in "
                f"earlier frames distances of 10 m are off by {1000 * wrong_px / self._disparity_at_1m_px:.1f} %"
            )
        if self.refused:
            notes.append(f"{counted(self.refused, 'frame')} refused, the first: {self.first_refusal}")
        if self.inertial_problem:
            notes.append(self.inertial_problem)
        if lost := self.count(Status.LOST):
            notes.append(f"tracking was lost in {counted(lost, 'frame')}, {self._first(Status.LOST)}")
        if 2 * (degraded := self.count(Status.DEGRADED)) > len(self):  # the recording is at fault, not the scene
            notes.append(f"{degraded} of {counted(len(self), 'frame')} degraded, {self._first(Status.DEGRADED)}")
        return [*notes, *([self.failure] if self.failure else [])]

    def _first(self, status: Status) -> str:
        row = self.statuses.index(status)
        return f"first at {(self._stamps_ns[row] - self._stamps_ns[0]) / 1e9:.2f} s: {self.reasons[row]}"

    def problem(self, one_wanted: bool) -> str:
        """Return why no motion was estimated, empty if one was; a single frame suffices only if `one_wanted`."""
        tracked = self.count(Status.OK) + self.count(Status.DEGRADED)
        if self.count(Status.LOST) and not tracked:
            return f"tracking was lost in every frame: {self.reasons[self.statuses.index(Status.LOST)]}"
        if len(self) == 1 and not one_wanted:
            return "only one stereo frame could be estimated, so that there is no motion"
        return ""

    def summary(self) -> dict[str, Any]:
        """Return the part of summary.json that follows from the estimates: statuses, durations, lengths."""
        wall_s = float(self.column("total").sum()) / 1e3
        return {
            "statuses": {status.value: self.count(status) for status in Status},
            "duration_s": (self._stamps_ns[-1] - self._stamps_ns[0]) / 1e9 if len(self) else 0.0,
            **{of.figure.key: of.value(self) for of in OF_RUN if of.row},
            "timing_ms": {
                stage: quantiles(self.column(stage)) or dict.fromkeys(("p50", "p95", "max")) for stage in STAGES
            },
            "frames_per_s": len(self) / wall_s if wall_s else 0.0,
        }


class RunFigure(NamedTuple):
    """A figure of a run without ground truth: its `value` is in report.json under the key of `figure`.

    `row`: the text that `replay` prints, filled in from summary.json, which then has it, and with the `length` unit.
    `further`: it is a column of the further figures on the page of `compare`.
    """

    figure: Figure
    value: Callable[[RunRecord], float | None]
    row: str = ""
    further: bool = False


OF_RUN = (
    RunFigure(TIME[0], lambda run: median(run.column("frontend") + run.column("estimator"))),
    RunFigure(
        Figure("path_length_m", "path"),
        lambda run: path_length_m(run.poses),
        row="{path_length_m:.3f} {length} in {duration_s:.2f} s",
    ),
    RunFigure(NIS, lambda run: _ratio(run.column("nis").sum(), run.column("nis_dof").sum()), further=True),
    RunFigure(
        Figure("reprojection_rms_px", "reprojection", "px"),
        lambda run: median(run.column("reprojection_px")),
        further=True,
    ),
    RunFigure(Figure("local_sigma_median_m", "σ of points", "m"), lambda run: median(run.column("sigma_local_m"))),
)


def median(values: ArrayLike) -> float | None:
    """Return the median of the finite values; None if there are none."""
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    return median_of_finite(finite) if len(finite) else None


def _ratio(numerator: float, denominator: float) -> float | None:
    return float(numerator / denominator) if denominator else None


class AddedMotions:
    """Records the path of the newest motions of the window, added up."""

    def __init__(self) -> None:
        self._odometry: Odometry | None = None
        self._rows = array("d")
        self._stamps_ns = array("q")

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        """Add the newest motion of the window; `estimates`: by method."""
        if (estimate := estimates.get(REFERENCE)) is None:
            return
        self._odometry = now = Odometry.after(self._odometry, estimate)
        self._stamps_ns.append(estimate.stamp_ns)
        self._rows.frombytes(np.concatenate([now.odom_from_cam, now.cov], axis=None).tobytes())

    def trajectory(self) -> Trajectory:
        """Return all poses with their covariances."""
        table = np.array(self._rows).reshape(-1, _COV.stop)
        poses = table[:, _POSE].reshape(-1, 4, 4)
        return Trajectory(np.array(self._stamps_ns, np.int64), poses, table[:, _COV].reshape(-1, 6, 6))


class HalvesRecord:
    """The results of a method from two halves of the tracks: poses, NaN where it was lost, and their distance in σ."""

    def __init__(self) -> None:
        self._poses, self._nees = array("d"), array("d")

    def add(self, poses: Array, nees: float) -> None:
        """Add the poses (2, 4, 4) of a frame, and the NEES of their difference."""
        self._poses.frombytes(np.ascontiguousarray(poses, float).tobytes())
        self._nees.append(nees)

    def __len__(self) -> int:
        return len(self._nees)

    @property
    def poses(self) -> Array:
        """Poses (2, n, 4, 4) of the two halves."""
        return np.array(self._poses).reshape(-1, 2, 4, 4).swapaxes(0, 1)

    @property
    def nees_mean(self) -> float | None:
        """The mean of the NEES, 6 expected; None if there is none."""
        nees = np.array(self._nees)
        return float(np.nanmean(nees)) if np.isfinite(nees).any() else None


def quantiles(values: Any) -> dict[str, float] | None:
    """Return median, 95th percentile and maximum of some values; None if there are none."""
    if not len(values):
        return None
    ordered = np.sort(values)  # np.quantile imports masked arrays
    p50, p95 = np.interp(np.array([0.5, 0.95]) * (len(ordered) - 1), np.arange(len(ordered)), ordered)
    return {"p50": float(p50), "p95": float(p95), "max": float(ordered[-1])}


class FrontRecord:
    """Records, frame by frame, what all methods share.

    `lives`: track id -> [first frame, last frame]; `local_difference_m`: median distance of CC and WC points per frame.
    """

    def __init__(self) -> None:
        self.times_ms: dict[str, list[float]] = {"decode": [], "rectify": [], "frontend": []}
        self.lives: dict[int, list[int]] = {}
        self.local_difference_m: list[float] = []
        self._stamps_ns: list[int] = []

    def __len__(self) -> int:
        return len(self.times_ms["decode"])

    @property
    def gaps(self) -> list[int]:
        """The frames that follow a gap in time."""
        return [frame + 1 for frame in gaps_after(self._stamps_ns)]

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        """Add one frame; `estimates`: by method."""
        index = observed.observations.frame_index
        for stage, times in self.times_ms.items():
            times.append(observed.timings_ms[stage])
        for track in observed.observations.track_ids.tolist():
            self.lives.setdefault(track, [index, index])[1] = index
        self._stamps_ns.append(observed.observations.stamp_ns)
        if (cc := estimates.get("cross-frame-cc")) and (wc := estimates.get("cross-frame-wc")):
            _, i, j = np.intersect1d(cc.track_ids, wc.track_ids, return_indices=True)
            if len(i):
                apart_m = np.linalg.norm(cc.points_in_cam[i] - wc.points_in_cam[j], axis=1)
                self.local_difference_m.append(float(np.median(apart_m)))

    def tracks(self) -> dict[str, Any]:
        """Return how many points were tracked, and over how many frames."""
        lengths = np.array([last - first + 1 for first, last in self.lives.values()])
        if not len(lengths):
            return {"count": 0, "mean_frames": None, "median_frames": None, "longest_frames": None}
        return {
            "count": len(lengths),
            "mean_frames": float(lengths.mean()),
            "median_frames": float(np.median(lengths)),
            "longest_frames": int(lengths.max()),
        }


class Truth(NamedTuple):
    """The truth for a comparison: `poses`, None if there are none, NaN where they must not be used.

    `ignored`: ranges [first, end) of frames whose truth is ignored on request; `std`: σ of the truth itself, m and rad.
    """

    poses: Trajectory | None = None
    ignored: Sequence[tuple[int, int]] = ()
    std: tuple[float, float] = (0.0, 0.0)


@dataclass(slots=True, eq=False, repr=False)
class Comparison:
    """Everything from which the report of a comparison is made.

    `inspection` as `inspect_log` returns it, or empty; `self_test`: its result, if it was run;
    `calibration`: the findings of the images about it, as in summary.json; `loops` (n, 2, 3): ends of the lines of
    loops; `needles`: the matches of one frame. `halves`: by method, if they were also estimated from halves of the
    tracks. `as_is`: each method had the calibration of the log.
    """

    log: str
    rig: StereoRig
    config: Config
    runs: list[RunRecord]
    front: FrontRecord
    truth: Truth
    inspection: dict[str, Any]
    warnings: list[str] = field(default_factory=list)
    complete: bool = True
    interrupted: bool = False
    self_test: dict[str, list[dict[str, Any]]] | None = None
    calibration: dict[str, Any] | None = None
    loops: Array = field(default_factory=lambda: NO_LOOPS)
    needles: "Needles | None" = None
    halves: dict[str, HalvesRecord] = field(default_factory=dict)
    as_is: bool = False
