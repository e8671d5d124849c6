"""Makes summary.json, for `replay` and for every method of `compare`."""

from typing import Any

from ..config import Config
from ..evaluation import StructureComparison, evaluate, evaluate_unscaled
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
    backwards: int = 0,
    further: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the content of summary.json; `further` fields come before those of the ground truth.

    The last `backwards` estimates are of frames that were fed backwards; they are not compared with ground truth.
    """
    summary = {
        "log": str(log.path),
        "method": config.method,
        "unscaled": config.mono,
        "unit_of_length": UNIT_WITHOUT_SCALE if config.mono else "metre",
        "complete": complete,
        "warnings": warnings,
        "frames": frame_counts(log.stats, statistics, selection, backwards),
        **statistics.summary(),
        **(further or {}),
    }
    if truth is not None:
        trajectory = statistics.trajectory(len(statistics) - backwards)
        summary["ground_truth"] = (
            evaluate_unscaled(trajectory, truth) if config.mono else evaluate(trajectory, truth, structure)
        )
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
