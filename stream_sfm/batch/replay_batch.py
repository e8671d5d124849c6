"""Many logs in one call: find them, replay each in its own process, collect the results."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ..camera.calibration.read import Where
from ..camera.rig import checked_paths
from ..config import Config
from ..executors import cluster
from ..recording.truth_file import GroundTruthFile
from ..run.refine import check_calibrates
from ..types import Selection
from .collect import run_batch
from .job import JobResult
from .logs import find_logs


def replay_batch(
    logs: Sequence[str | Path],
    out_dir: str | Path,
    config: Config | None = None,
    selection: Selection | None = None,
    *,
    left: str | None = None,
    right: str | None = None,
    calibration: Where | None = None,
    calibrate: bool = False,
    ground_truth: str | Path | GroundTruthFile | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    timeout_s: float = 600.0,
    on_done: Callable[[JobResult], None] | None = None,
) -> dict[str, Any]:
    """Replay many logs, each in its own process, into one folder per log, and return the content of batch.json.

    `logs`: recordings of any kind, folders of them, patterns. `calibrate`: as in `replay`, each log by itself.
    `ground_truth`: a file for all logs, or a folder with files that are named after the logs, instead of what the logs
    have. `workers` processes of this machine (None: one per core), or those of the Dask `scheduler`. A log that
    delivers no frame for `timeout_s` is stopped; `on_done` is called with the result of each. A second call processes
    only what is missing or has changed. Raises ConfigError, LogError and OutputError before any log is started.
    """
    config = config or Config()
    config.needs_scale("a batch, which compares metres,")
    if calibrate:
        check_calibrates(config)
    calibrations = [] if calibration is None else checked_paths(calibration)
    truth = ground_truth if isinstance(ground_truth, GroundTruthFile | None) else GroundTruthFile(ground_truth)
    skipped: list[str] = []
    found = find_logs([str(log) for log in logs], skipped)
    # the threads only wait for the processes that replay
    with cluster(scheduler) if scheduler else ThreadPoolExecutor(workers or os.cpu_count() or 1) as executor:
        return run_batch(
            found,
            Path(out_dir),
            config,
            executor,
            options=_replay_options(left, right, selection or Selection(), truth, calibrate),
            calibration=calibrations,
            truth=None if truth is None else Path(truth.path).resolve(),
            timeout_s=timeout_s,
            skipped=skipped,
            on_done=on_done,
        )


def _replay_options(
    left: str | None, right: str | None, selection: Selection, truth: GroundTruthFile | None, calibrate: bool
) -> list[str]:
    """What was chosen, as options of the command `replay`, which the process of each log runs."""
    chosen: dict[str, object] = {
        "left": left,
        "right": right,
        "start": selection.start_s,
        "end": selection.end_s,
        "max-frames": selection.max_frames,
        "stride": None if selection.stride == 1 else selection.stride,
        "calibrate": calibrate or None,
    }
    if truth is not None:
        chosen |= {"ground-truth-frame": _frame(truth), "ground-truth-offset": truth.offset_s or None}
    given = {name: value for name, value in chosen.items() if value is not None}
    return [f"--{name}" if value is True else f"--{name}={value}" for name, value in given.items()]


def _frame(truth: GroundTruthFile) -> str | None:
    """The frame for a process in another folder: a file by its absolute path."""
    if truth.frame is None:
        return None
    path = Path(truth.frame)
    return str(path.resolve() if path.is_file() else truth.frame)
