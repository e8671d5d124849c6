"""Many logs in one call: find them, replay each in its own process, collect the results."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ..camera.rig import StereoRig
from ..config import Config
from ..executors import cluster
from ..types import Selection
from .collect import run_batch
from .job import JobResult
from .logs import find_logs

_ANY_SIZE = (1000, 1000)  # of images, pixels


def replay_batch(
    logs: Sequence[str | Path],
    out_dir: str | Path,
    config: Config | None = None,
    selection: Selection | None = None,
    *,
    left: str | None = None,
    right: str | None = None,
    calibration: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    timeout_s: float = 600.0,
    on_done: Callable[[JobResult], None] | None = None,
) -> dict[str, Any]:
    """Replay many logs, each in its own process, into one folder per log, and return the content of batch.json.

    `logs`: recordings of any kind, folders of them, patterns. `workers` processes of this machine (None: one per
    core), or those of the Dask `scheduler`. A log that delivers no frame for `timeout_s` is stopped; `on_done` is
    called with the result of each. A second call processes only what is missing or has changed. Raises ConfigError,
    LogError and OutputError before any log is started.
    """
    config = config or Config()
    config.needs_scale("a batch, which compares metres,")
    calibration = None if calibration is None else Path(calibration).resolve()
    if calibration is not None:
        # A mistake in it is reported once, before any log is started; each log knows the size of its images.
        StereoRig.from_calibration(calibration, image_size=_ANY_SIZE)
    skipped: list[str] = []
    found = find_logs([str(log) for log in logs], skipped)
    # the threads only wait for the processes that replay
    with cluster(scheduler) if scheduler else ThreadPoolExecutor(workers or os.cpu_count() or 1) as executor:
        return run_batch(
            found,
            Path(out_dir),
            config,
            executor,
            options=_replay_options(left, right, selection or Selection()),
            calibration=calibration,
            timeout_s=timeout_s,
            skipped=skipped,
            on_done=on_done,
        )


def _replay_options(left: str | None, right: str | None, selection: Selection) -> list[str]:
    """What was chosen, as options of the command `replay`, which the process of each log runs."""
    chosen = {
        "left": left,
        "right": right,
        "start": selection.start_s,
        "end": selection.end_s,
        "max-frames": selection.max_frames,
        "stride": None if selection.stride == 1 else selection.stride,
    }
    return [f"--{name}={value}" for name, value in chosen.items() if value is not None]
