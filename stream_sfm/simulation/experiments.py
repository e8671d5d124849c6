"""The studies by name, and the writing of their results."""

import os
from functools import partial
from pathlib import Path

import msgspec

from ..errors import ConfigError, OutputError, as_error, require_study
from ..system.executors import processes
from ..system.files import json_bytes, make_folder, write_whole
from . import figure6
from .calibration import CALIBRATION
from .rates import RATES
from .studies import CONSISTENCY, EFFICIENCY, Progress, Report
from .tables import to_csv

EXPERIMENTS = {
    "efficiency": EFFICIENCY, "consistency": CONSISTENCY, "rates": RATES, "calibration": CALIBRATION,
    "figure6": figure6.FIGURE6,
}  # fmt: skip


def simulate(
    experiment: str,
    out_dir: str | Path | None = None,
    *,
    trials: int = 100,
    seed: int = 0,
    workers: int | None = None,
    on_progress: Progress | None = None,
) -> Report:
    """Run a Monte Carlo study on the paper's simulated stereo pair, and return the content of results.json.

    `experiment`: efficiency, consistency, calibration, rates or figure6. `out_dir`: for results.json, results.csv and
    the picture of figure6. `workers`: processes (None: one per core); the numbers depend on `seed` alone. `on_progress`
    is called with the number of trials just finished. If it is interrupted, the report is on the trials finished so far
    and says so; KeyboardInterrupt if these are too few. Raises ConfigError, OutputError.
    """
    if experiment not in EXPERIMENTS:
        raise ConfigError(f"experiment {experiment!r} is not known; known are {', '.join(EXPERIMENTS)}")
    require_study("a study")
    is_new = out_dir is not None and not Path(out_dir).exists()
    if out_dir is not None:
        make_folder(Path(out_dir))
    pool = partial(processes, workers or os.cpu_count() or 1)
    try:
        found, done = EXPERIMENTS[experiment].run(trials, seed, pool, on_progress)
    except KeyboardInterrupt:
        if out_dir is not None and is_new:
            Path(out_dir).rmdir()
        raise
    ended = {"interrupted": True} if done < trials else {}
    report: Report = msgspec.to_builtins({"experiment": experiment, "trials": done, "seed": seed, **ended, **found})
    if out_dir is not None:
        write_whole(Path(out_dir, "results.json"), json_bytes(report))
        write_whole(Path(out_dir, "results.csv"), to_csv(report).encode())
        if experiment == "figure6":
            with as_error(OutputError, f"cannot write to {out_dir}", OSError):
                figure6.draw(report, Path(out_dir))
    return report
