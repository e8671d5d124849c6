"""What a replay remembers of each frame, little enough for any length, and the figures made of it."""

from array import array
from typing import Any

import numpy as np

from ..errors import FrameError
from ..evaluation import path_length_m
from ..geometry.se3 import Array
from ..recording import ReadStats
from ..types import FrameEstimate, Status, Trajectory

STAGES = ("decode", "frontend", "estimator", "total")


class Account:
    """Poses, covariances, times and statuses of a run."""

    def __init__(self) -> None:
        self.stamps_ns = array("q")
        self._poses = array("d")
        self._covs = array("d")
        self._times_ms = {stage: array("d") for stage in STAGES}
        self.statuses = dict.fromkeys((s.value for s in Status), 0)
        self.refused = 0
        self.first_refusal: FrameError | None = None
        self._first_lost: FrameEstimate | None = None

    def add(self, estimate: FrameEstimate, decode_s: float, total_s: float) -> None:
        """Remember one estimate; `total_s` from asking for the frame until its results are written."""
        self.stamps_ns.append(estimate.stamp_ns)
        self._poses.frombytes(np.ascontiguousarray(estimate.world_from_cam, dtype=float).tobytes())
        self._covs.frombytes(np.ascontiguousarray(estimate.cov_pose, dtype=float).tobytes())
        timings = estimate.timings_ms
        self._times_ms["decode"].append(1e3 * decode_s)
        self._times_ms["frontend"].append(timings.get("rectify", 0.0) + timings.get("frontend", 0.0))
        self._times_ms["estimator"].append(timings.get("estimator", 0.0))
        self._times_ms["total"].append(1e3 * total_s)
        self.statuses[str(estimate.status)] += 1
        if estimate.status == Status.LOST and self._first_lost is None:
            self._first_lost = estimate

    def refuse(self, error: FrameError) -> None:
        """The engine did not take a frame."""
        self.refused += 1
        self.first_refusal = self.first_refusal or error

    def trajectory(self) -> Trajectory:
        """All poses with their covariances."""
        return Trajectory(
            np.array(self.stamps_ns, dtype=np.int64), _stacked(self._poses, 4), _stacked(self._covs, 6)
        )

    def warnings(self) -> list[str]:
        """Frames that were refused or lost, for people."""
        notes = []
        if self.refused:
            notes.append(f"{self.refused} frames were refused, the first: {self.first_refusal}")
        if self._first_lost is not None:
            at_s = (self._first_lost.stamp_ns - self.stamps_ns[0]) / 1e9
            notes.append(
                f"tracking was lost in {self.statuses['lost']} frames, first at {at_s:.2f} s: "
                f"{self._first_lost.reason}"
            )
        return notes

    def figures(self) -> dict[str, Any]:
        """Durations and lengths: the part of the summary that follows from the estimates."""
        n = len(self.stamps_ns)
        wall_s = sum(self._times_ms["total"]) / 1e3
        return {
            "statuses": dict(self.statuses),
            "duration_s": (self.stamps_ns[-1] - self.stamps_ns[0]) / 1e9 if n else 0.0,
            "path_length_m": path_length_m(_stacked(self._poses, 4)),
            "timing_ms": {stage: _percentiles(times) for stage, times in self._times_ms.items()},
            "frames_per_s": n / wall_s if wall_s else 0.0,
        }


def log_figures(stats: ReadStats, account: Account, whole: bool) -> dict[str, int]:
    """`frames` of the summary. `read`: left images read; `paired`: stereo frames among them, of the selection if
    the replay was not of the `whole` log; `estimated`: frames with an estimate of any status, of which `degraded`
    and `lost`; `dropped`: images out of order, undecodable or refused."""
    estimated = len(account.stamps_ns)
    return {
        "read": stats.left_read,
        "paired": stats.paired if whole else estimated + account.refused,
        "estimated": estimated,
        "degraded": account.statuses["degraded"],
        "lost": account.statuses["lost"],
        "dropped": stats.dropped_backwards + stats.undecodable + account.refused,
    }


def peak_rss_mib() -> float | None:
    """Largest resident memory of this process so far, MiB; None where the system does not tell."""
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
