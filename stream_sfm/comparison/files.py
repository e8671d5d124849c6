"""The files of a comparison: a folder a method as `replay` writes it, report.html and report.json."""

from pathlib import Path
from typing import Any

import msgspec

from ..config import Config, config_to_toml
from ..errors import OutputError
from ..evaluation import evaluate
from ..files import json_bytes, write_whole
from ..pipeline.accounting import Account, log_figures
from ..pipeline.replay import Sink
from ..recording import StereoLog
from ..report.page import write_report
from ..report.records import Comparison, MethodRun
from ..results.estimates_writer import EstimatesWriter
from ..results.trajectory_files import KittiWriter, TumWriter
from ..types import FrameEstimate
from .compare import COMPARED, Selection, compare


class _Counted:
    """A sink that makes an `Account`, for the summary."""

    def __init__(self) -> None:
        self.account = Account()

    def write(self, estimate: FrameEstimate) -> None:
        times = estimate.timings_ms
        self.account.add(estimate, times["decode"] / 1e3, sum(times.values()) / 1e3)

    def close(self) -> None:
        """Nothing to finish."""


def compare_into(
    log: StereoLog,
    folder: Path,
    config: Config,
    methods: tuple[str, ...] = COMPARED,
    selection: Selection | None = None,
    **options: Any,
) -> tuple[Comparison, dict[str, Any]]:
    """Compare, and write everything to `folder`; also the content of report.json. `options` go to `compare`."""
    counts: dict[str, _Counted] = {}

    def sinks(method: str) -> list[Sink]:
        counts[method] = _Counted()
        return [counts[method], _Folder(folder / method.replace("-", "_"), log, _with(config, method))]

    comparison = compare(log, config, methods, selection, make_sink=sinks, **options)
    for run in comparison.runs:
        if run.poses:
            summary = _summary(comparison, run, log, counts[run.name].account, selection is None)
            write_whole(folder / run.key / "summary.json", json_bytes(summary))
    return comparison, write_report(comparison, folder)


class _Folder:
    """The files of one method, opened with its first estimate."""

    def __init__(self, path: Path, log: StereoLog, config: Config) -> None:
        self._path, self._log, self._config = path, log, config
        self._sinks: list[Sink] = []

    def write(self, estimate: FrameEstimate) -> None:
        """Append one frame to each file."""
        if not self._sinks:
            try:
                self._path.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise OutputError(f"cannot make the folder {self._path}: {error.strerror}") from None
            write_whole(self._path / "config.toml", config_to_toml(self._config).encode())
            self._sinks = [
                EstimatesWriter(self._path / "estimates.mcap", self._log.stereo_rig, self._config),
                TumWriter(self._path / "trajectory.tum"),
                KittiWriter(self._path / "trajectory.kitti"),
            ]
        for sink in self._sinks:
            sink.write(estimate)

    def close(self) -> None:
        """Move the files into place."""
        for sink in self._sinks:
            sink.close()


def _summary(c: Comparison, run: MethodRun, log: StereoLog, account: Account, whole: bool) -> dict[str, Any]:
    summary = {
        "log": str(log.path),
        "method": run.name,
        "complete": c.complete and not run.failure,
        "warnings": [*c.warnings, *account.warnings(), *([run.failure] if run.failure else [])],
        "frames": log_figures(log.stats, account, whole),
        **account.figures(),
    }
    if c.truth is not None:
        summary["ground_truth"] = evaluate(run.trajectory(), c.truth, run.structure)
    return summary


def _with(config: Config, method: str) -> Config:
    return msgspec.structs.replace(config, method=method)
