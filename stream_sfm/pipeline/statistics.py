"""What a run remembers of its frames, some 1500 bytes of each, and the part of the summary that follows from it."""

import time
from array import array
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..camera.refinement import disparity_rms_px
from ..errors import FrameError
from ..evaluation import path_length_m
from ..evaluation.relative_consistency import RelativeRecord
from ..geometry.se3 import Array
from ..report.run_page import RunColumns
from ..types import Frame, FrameEstimate, RigChange, RigEstimate, Status, Trajectory

STAGES = ("decode", "frontend", "estimator", "total")
COUNTS = ("tracked", "new", "used", "rejected")
_STATUSES = list(Status)
# Frames: real calibrations are corrected within the first two or three, which their poses hardly show.
_AT_THE_START = 10
_MANY_DEGRADED = 0.5  # of the frames: more, and something is wrong with the recording rather than with a scene
T = TypeVar("T")


class Stopwatch:
    """Times a run frame by frame; `waited_s` is how long the run waited for the current frame."""

    def __init__(self) -> None:
        self.waited_s = 0.0
        self._asked_s = time.perf_counter()

    def frames(self, frames: Iterable[T]) -> Iterator[T]:
        """Yield the same frames and time them."""
        self._asked_s = time.perf_counter()
        for frame in frames:
            self.waited_s = self.elapsed_s
            yield frame
            self._asked_s = time.perf_counter()

    @property
    def elapsed_s(self) -> float:
        """Seconds since the run asked for the current frame."""
        return time.perf_counter() - self._asked_s


class RunStatistics:
    """A sink that keeps poses, covariances and times, and counts the frames of each status.

    With a stopwatch, the total time of a frame is from asking for it until it is written here, after the results.
    Without one, where several methods share a frame, it is the sum of the estimate's own timings.
    """

    def __init__(self, stopwatch: Stopwatch | None = None) -> None:
        self._stopwatch = stopwatch
        self.stamps_ns = array("q")
        self._poses = array("d")
        self._covs = array("d")
        self._times_ms = {stage: array("d") for stage in STAGES}
        self._status = array("b")  # its place in Status
        self._counts = {name: array("i") for name in COUNTS}
        self._nis = array("d")  # per degree of freedom
        self.statuses = dict.fromkeys((s.value for s in Status), 0)
        self.refused = 0
        self.first_refusal: FrameError | None = None
        self._first_lost: FrameEstimate | None = None
        self._first_degraded = (0, "")  # stamp and reason
        self.rig: RigEstimate | None = None  # the latest one
        self.rig_changes: list[RigChange] = []
        self._corrected_from: tuple[int, RigEstimate] | None = None  # the first frame, and what was corrected in it
        self.relative = RelativeRecord()

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Remember one estimate."""
        self.stamps_ns.append(estimate.stamp_ns)
        self._poses.frombytes(np.ascontiguousarray(estimate.world_from_cam, dtype=float).tobytes())
        self._covs.frombytes(np.ascontiguousarray(estimate.cov_pose, dtype=float).tobytes())
        timings = estimate.timings_ms
        if self._stopwatch is None:
            decode_ms, total_ms = timings.get("decode", 0.0), sum(timings.values())
        else:
            decode_ms, total_ms = 1e3 * self._stopwatch.waited_s, 1e3 * self._stopwatch.elapsed_s
        self._times_ms["decode"].append(decode_ms)
        self._times_ms["frontend"].append(timings.get("rectify", 0.0) + timings.get("frontend", 0.0))
        self._times_ms["estimator"].append(timings.get("estimator", 0.0))
        self._times_ms["total"].append(total_ms)
        self._status.append(_STATUSES.index(estimate.status))
        for name in COUNTS:
            self._counts[name].append(estimate.counts[name])
        self._nis.append(estimate.nis / estimate.nis_dof if estimate.nis_dof > 0 else float("nan"))
        self.statuses[str(estimate.status)] += 1
        self._write_rig(estimate)
        self.relative.add(estimate)
        if estimate.status == Status.LOST and self._first_lost is None:
            self._first_lost = estimate
        if estimate.status == Status.DEGRADED and self.statuses[Status.DEGRADED] == 1:
            self._first_degraded = (estimate.stamp_ns, estimate.reason)

    def _write_rig(self, estimate: FrameEstimate) -> None:
        self.rig = estimate.rig or self.rig
        if estimate.rig_change is not None:
            self.rig_changes.append(estimate.rig_change)
        if self._corrected_from is None and not self.rig_changes and estimate.rig and estimate.rig.applied:
            self._corrected_from = (estimate.frame_index, estimate.rig)

    def close(self) -> None:
        """Nothing to finish."""

    def refuse(self, error: FrameError) -> None:
        """Count a frame that the engine refused."""
        self.refused += 1
        self.first_refusal = self.first_refusal or error

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def trajectory(self, frames: int | None = None) -> Trajectory:
        """Return the poses of the first `frames` frames (None: all) with their covariances."""
        stamps_ns = np.array(self.stamps_ns, dtype=np.int64)[:frames]
        return Trajectory(stamps_ns, _stacked(self._poses, 4)[:frames], _stacked(self._covs, 6)[:frames])

    def columns(self, frames: int) -> RunColumns:
        """Return what the page of a run shows of its first `frames` frames."""
        return RunColumns(
            self.trajectory(frames),
            [_STATUSES[k] for k in self._status[:frames]],
            {name: np.array(values[:frames], float) for name, values in self._counts.items()},
            np.array(self._nis[:frames]),
            {stage: np.array(times[:frames]) for stage, times in self._times_ms.items()},
        )

    def warnings(self, disparity_at_1m_px: float) -> list[str]:
        """Return sentences about a calibration that was wrong or has changed, and about bad frames.

        These were refused or lost, or many are degraded. `disparity_at_1m_px`: focal length times baseline.
        """
        notes = [str(change) for change in self.rig_changes]
        if self._corrected_from is not None and self._corrected_from[0] > _AT_THE_START:
            frame, rig = self._corrected_from
            wrong_px = disparity_rms_px(rig.mean if rig.refined is None else rig.mean - rig.refined)
            notes.append(
                f"from frame {frame} on an error of the calibration is corrected, {wrong_px:.2f} px of disparity; the "
                "frames before were estimated with it: distances of 10 m were off by "
                f"{10 * wrong_px / disparity_at_1m_px:.1%}"
            )
        if self.refused:
            notes.append(f"{self.refused} frames were refused, the first: {self.first_refusal}")
        if self._first_lost is not None:
            at_s = (self._first_lost.stamp_ns - self.stamps_ns[0]) / 1e9
            notes.append(
                f"tracking was lost in {self.statuses['lost']} frames, first at {at_s:.2f} s: "
                f"{self._first_lost.reason}"
            )
        if self.statuses[Status.DEGRADED] > _MANY_DEGRADED * len(self):
            stamp_ns, reason = self._first_degraded
            at_s = (stamp_ns - self.stamps_ns[0]) / 1e9
            notes.append(
                f"{self.statuses[Status.DEGRADED]} of {len(self)} frames are degraded, first at {at_s:.2f} s: {reason}"
            )
        return notes

    def problem(self, one_wanted: bool) -> str:
        """Return why no motion was estimated, empty if it was; a single frame is enough only where `one_wanted`."""
        tracked = self.statuses[Status.OK] + self.statuses[Status.DEGRADED]
        if self._first_lost is not None and not tracked:
            return f"tracking was lost in every frame: {self._first_lost.reason}"
        if len(self) == 1 and not one_wanted:
            return "only one stereo frame could be estimated, so that there is no motion"
        return ""

    def summary(self) -> dict[str, Any]:
        """Return the part of summary.json that follows from the estimates: statuses, durations, lengths."""
        n = len(self.stamps_ns)
        wall_s = sum(self._times_ms["total"]) / 1e3
        return {
            "statuses": dict(self.statuses),
            "duration_s": (self.stamps_ns[-1] - self.stamps_ns[0]) / 1e9 if n else 0.0,
            "path_length_m": path_length_m(_stacked(self._poses, 4)),
            "timing_ms": {stage: _percentiles(times) for stage, times in self._times_ms.items()},
            "frames_per_s": n / wall_s if wall_s else 0.0,
        }


def peak_rss_mib() -> float | None:
    """Return the largest resident memory of this process so far, MiB; None where the system does not know it."""
    try:  # Linux; getrusage would count what the process that started this one had needed
        line = next(
            line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM:")
        )
        return int(line.split()[1]) / 2**10
    except (OSError, StopIteration):
        pass
    try:
        import resource
    except ImportError:
        return None
    import sys

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def _stacked(numbers: "array[float]", size: int) -> Array:
    return np.array(numbers).reshape(-1, size, size)


def _percentiles(times: "array[float]") -> dict[str, float | None]:
    if not times:
        return {"p50": None, "p95": None, "max": None}
    p50, p95 = np.percentile(np.array(times), (50, 95))
    return {"p50": float(p50), "p95": float(p95), "max": max(times)}
