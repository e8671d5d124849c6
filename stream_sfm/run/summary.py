"""Makes summary.json, for `replay` and for every method of `compare`."""

import resource
import sys
from pathlib import Path
from typing import Any

from ..evaluation.summary import end_pose, evaluate_run, evaluate_unscaled
from ..logs.recording.pair_reader import ReadStats
from ..logs.recording.stereo_log import StereoLog
from ..report.records import RunRecord, Truth
from ..results.folder import UNIT_WITHOUT_SCALE
from ..types import Selection, Status
from .lane import Lane


def summarise(
    log: StereoLog,
    stats: ReadStats,
    lane: Lane,
    selection: Selection,
    truth: Truth,
    complete: bool,
    warnings: list[str],
    further: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the content of summary.json of a lane; `stats`: of reading the log; `complete`, `warnings`: of the
    run.

    `further` fields come before those of the ground truth.
    """
    config, record = lane.config, lane.record
    trajectory = record.trajectory()
    summary: dict[str, Any] = {
        "log": str(log.path),
        "method": config.method,
        "unscaled": config.mono,
        "unit_of_length": UNIT_WITHOUT_SCALE if config.mono else "metre",
        "complete": complete and not record.failure,
        "warnings": list(dict.fromkeys([*warnings, *record.warnings()])),
        "frames": _frame_counts(stats, selection, record),
        **record.summary(),
        "end": None if config.mono else end_pose(trajectory),
        "imu": record.inertial(),
        **(further or {}),
    }
    if truth.poses is None:
        return summary
    if config.mono:
        figures = evaluate_unscaled(trajectory, truth.poses)
    else:
        figures = evaluate_run(trajectory, record.relative, truth.poses, truth.std, record.structure)
    summary["ground_truth"] = figures | {"frames_ignored": [list(r) for r in truth.ignored]}
    return summary


def _frame_counts(stats: ReadStats, selection: Selection, record: RunRecord) -> dict[str, int]:
    """Return the section `frames` of the summary.

    `read`: left images read; `paired`: stereo frames among them, or of the selection if it is a part of the log;
    `estimated`: frames with an estimate of any status, `degraded`, `lost` among them; `dropped`:
    images that were out of order, undecodable or refused.
    """
    return {
        "read": stats.left_read,
        "paired": stats.paired if selection.is_everything else len(record) + record.refused,
        "estimated": len(record),
        "degraded": record.count(Status.DEGRADED),
        "lost": record.count(Status.LOST),
        "dropped": stats.dropped_backwards + stats.undecodable + record.refused,
    }


def peak_rss_mib() -> float:
    """Return the largest resident memory of this process so far, MiB."""
    try:  # Linux; getrusage would include the memory of the parent process
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 2**10
    except (OSError, StopIteration):
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak / (2**20 if sys.platform == "darwin" else 2**10)
