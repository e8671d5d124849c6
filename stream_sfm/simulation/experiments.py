"""The studies by name: how each is run, how many trials it takes, and how its results are written."""

import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from ..errors import ConfigError, OutputError
from ..executors import cluster, processes
from ..files import json_bytes, make_folder, write_whole
from . import calibration, figure6, rates, studies
from .trials import Progress

Report = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Experiment:
    """`run(trials, seed, executor, progress)` makes the report; `total_trials(trials)` are run altogether."""

    run: Callable[[int, int, Executor | None, Progress | None], Report]
    total_trials: Callable[[int], int]


EXPERIMENTS = {
    "efficiency": Experiment(studies.efficiency, studies.total_trials),
    "consistency": Experiment(studies.consistency, studies.total_trials),
    "rates": Experiment(rates.rates, rates.total_trials),
    "calibration": Experiment(calibration.calibration, calibration.total_trials),
    "figure6": Experiment(figure6.figure6, lambda trials: trials),
}


def simulate(
    experiment: str,
    out_dir: str | Path | None = None,
    *,
    trials: int = 100,
    seed: int = 0,
    workers: int | None = None,
    scheduler: str | None = None,
    on_progress: Progress | None = None,
) -> Report:
    """Run a Monte Carlo study on the paper's simulated stereo pair, and return the content of results.json.

    `experiment`: efficiency, consistency, calibration, rates or figure6; with `out_dir` results and figures are
    written. `workers` processes of this machine (None: one per core), or those of the Dask `scheduler`; the numbers
    depend on `seed` alone. `on_progress` is called with the number of trials just finished. Raises ConfigError,
    OutputError.
    """
    if experiment not in EXPERIMENTS:
        raise ConfigError(f"experiment {experiment!r} is not known; known are {', '.join(EXPERIMENTS)}")
    folder = None if out_dir is None else Path(out_dir)
    if folder is not None:
        make_folder(folder)
    with cluster(scheduler) if scheduler else processes(workers or os.cpu_count() or 1) as executor:
        report: Report = msgspec.to_builtins(EXPERIMENTS[experiment].run(trials, seed, executor, on_progress))
    if folder is not None:
        _write(experiment, report, folder)
    return report


def _write(name: str, report: Report, folder: Path) -> None:
    """Write results.json and the figures (PNG, SVG) into the folder. Raises OutputError."""
    write_whole(folder / "results.json", json_bytes(report))
    from . import figures  # matplotlib takes a second to import, and may be missing: after what took minutes

    try:
        figures.save(getattr(figures, name)(report), folder, name)
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror}") from None
