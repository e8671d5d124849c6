"""Makes summary.json, for `replay` and for every method of `compare`."""

from collections.abc import Sequence
from typing import Any

from ..config import Config
from ..evaluation import StructureComparison, evaluate, evaluate_unscaled
from ..evaluation.association import without_frames
from ..evaluation.end_pose import end_pose
from ..evaluation.relative_consistency import against_truth
from ..recording import ReadStats, StereoLog
from ..results.folder import UNIT_WITHOUT_SCALE
from ..types import Selection, Trajectory
from .statistics import RunStatistics


def summarise(
    log: StereoLog,
    config: Config,
    selection: Selection,
    statistics: RunStatistics,
    *,
    complete: bool,
    warnings: list[str],
    truth: Trajectory | None,
    structure: StructureComparison | None,
    std_truth: tuple[float, float] = (0.0, 0.0),
    backwards: int = 0,
    ignored: Sequence[tuple[int, int]] = (),
    further: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the content of summary.json; `further` fields come before those of the ground truth.

    `std_truth`: σ of the ground truth itself, in metres and radians. The last `backwards` estimates are of frames that
    were fed backwards; they are not compared with ground truth, and neither are those in the ranges `ignored`.
    """
    summary: dict[str, Any] = {
        "log": str(log.path),
        "method": config.method,
        "unscaled": config.mono,
        "unit_of_length": UNIT_WITHOUT_SCALE if config.mono else "metre",
        "complete": complete,
        "warnings": warnings,
        "frames": frame_counts(log.stats, statistics, selection, backwards),
        **statistics.summary(),
        "end": None if config.mono else end_pose(statistics.trajectory(len(statistics) - backwards)),
        **(further or {}),
    }
    if truth is not None:
        there = len(statistics) - backwards
        trajectory = statistics.trajectory(there)
        used = without_frames(truth, trajectory.stamps_ns, ignored)
        summary["ground_truth"] = (
            evaluate_unscaled(trajectory, used) if config.mono else evaluate(trajectory, used, structure)
        ) | {"frames_in_doubt": [], "frames_ignored": [list(r) for r in ignored]}
        if not config.mono:
            spans = against_truth(statistics.relative, used, std_truth, len(trajectory))
            summary["ground_truth"] |= {"std_truth": list(std_truth), "relative_consistency": spans}
    return summary


def frame_counts(
    stats: ReadStats, statistics: RunStatistics, selection: Selection, backwards: int
) -> dict[str, int]:
    """Return `frames` of the summary.

    `read`: left images read; `paired`: stereo frames among them, or of the selection if it is a part of the log;
    `estimated`: frames with an estimate of any status, `degraded`, `lost` and `backwards` among them; `dropped`:
    images that were out of order, undecodable or refused.
    """
    estimated = len(statistics)
    return {
        "read": stats.left_read,
        "paired": stats.paired if selection.is_everything else estimated - backwards + statistics.refused,
        "estimated": estimated,
        "degraded": statistics.statuses["degraded"],
        "lost": statistics.statuses["lost"],
        "backwards": backwards,
        "dropped": stats.dropped_backwards + stats.undecodable + statistics.refused,
    }
