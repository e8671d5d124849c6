"""Compares methods on one log in one pass: a run with several lanes, a result folder each, and the report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from ..blas import one_thread
from ..camera.rig import StereoRig
from ..config import Config
from ..errors import ConfigError
from ..estimators import check_method
from ..evaluation.association import check_rigid, checked_ranges, without_frames
from ..interrupts import deferred_interrupts
from ..observer import Observer
from ..outputs import RESULTS, refuse_overwriting
from ..recording.stereo_log import StereoLog, open_log
from ..report.calibration import describe
from ..report.numbers import numbers
from ..report.pages import REPORT, write_report
from ..report.records import Comparison, FrontRecord, Truth
from ..types import Selection, Sink
from .lane import Lane
from .loop import run
from .self_test import SelfTest
from .summary import summarise

if TYPE_CHECKING:
    from ..places.place_map import PlaceMap

COMPARED = (
    "cross-frame", "cross-frame-wc", "cross-frame-cc", "ekf", "iterated-ekf", "ekf-cv", "frame-to-frame",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ComparisonResult:
    """The result of a comparison: `report` as in report.json, `out_dir` (None: nothing was written), all records."""

    report: dict[str, Any]
    out_dir: Path | None
    comparison: Comparison

    def __repr__(self) -> str:
        names = ", ".join(run.name for run in self.comparison.runs)
        return f"<ComparisonResult {self.comparison.log}: {names}, written to {self.out_dir}>"


def compare(
    log: str | Path | StereoLog,
    out_dir: str | Path | None = None,
    config: Config | None = None,
    selection: Selection | None = None,
    *,
    methods: Sequence[str] = COMPARED,
    left: str | None = None,
    right: str | None = None,
    calibration: str | Path | StereoRig | None = None,
    ignore_ground_truth: Sequence[tuple[int, int]] = (),
    inspection: dict[str, Any] | None = None,
    self_test: bool = False,
    loops: bool = False,
    std_truth: tuple[float, float] = (0.0, 0.0),
    sinks: Sequence[Sink] = (),
) -> ComparisonResult:
    """Run several methods on the selected frames of a log and write results and report to `out_dir` (None: nowhere).

    `left`, `right`, `calibration`: as in `open_log`. `methods`: names of METHODS, each with a folder of its own.
    `ignore_ground_truth`: ranges [first, end) of frames of this run whose ground truth is not compared.
    `inspection`: what `inspect_log` found, for the report. `self_test`, `std_truth`: as in `replay`. The
    errors of the calibration that the window finds are taken out of the views of the other methods too, so that methods
    are compared and not calibrations: from their first frame on those known after 30, if the window is named first.
    `sinks` are given one estimate per frame, of the first method that has not failed, and are closed at the end.
    `loops`: show the first method with loops closed, too, which need the extra map. Raises LogError where no frame can
    be read, ConfigError for an unknown method, OutputError.
    """
    config, selection = config or Config(), selection or Selection()
    config.needs_scale("compare")
    if not methods:
        raise ConfigError("no method is named: give those to compare, such as cross-frame and ekf")
    for name in methods:
        check_method(name)
    truth = Truth(None, checked_ranges(ignore_ground_truth), std_truth)
    if not isinstance(log, StereoLog):
        log = open_log(log, left, right, calibration)
    folder = None if out_dir is None else Path(out_dir)
    if folder is not None:
        refuse_overwriting(outputs(folder, methods), [log.path])
    if (poses := log.ground_truth()) is not None:
        check_rigid(poses)
    depth, front = log.depth_images(), FrontRecord()
    with one_thread:
        observer = Observer(log.stereo_rig, config)
        of_methods = [msgspec.structs.replace(config, method=name) for name in methods]
        lanes = [Lane(c, observer, depth, folder and folder / _key(c.method), True) for c in of_methods]
    tests = [SelfTest(observer.projection, config)] if self_test else []
    places = []
    if loops:
        from ..places.place_map import PlaceMap  # as in a replay

        places.append(PlaceMap(log.stereo_rig, lanes[0].config, wait=True))
    with deferred_interrupts() as interruption:
        course = run(log, lanes, [*places, *sinks], [front, *tests], selection=selection, interruption=interruption)
    if course.error is not None and not course.frames:
        raise course.error
    runs = [lane.record for lane in lanes]
    changes = map(str, runs[0].rig_changes)
    warnings = list(dict.fromkeys(filter(None, [*log.stats.warnings, depth.problem, *changes, *course.warnings])))
    if poses is not None:
        stamps_ns = max(runs, key=len).stamps_ns
        truth = truth._replace(poses=without_frames(poses, stamps_ns, truth.ignored))
    found = Comparison(
        log=log.path.absolute().name,  # which "." has too
        rig=log.stereo_rig,
        config=config,
        runs=runs,
        front=front,
        truth=truth,
        inspection=inspection or {},
        warnings=warnings,
        complete=log.stats.complete and course.complete,
        interrupted=course.interrupted,
        self_test=next((test.result() for test in tests), None),
        calibration=next((describe(observer.projection, r.rig) for r in runs if r.rig is not None), None),
    )
    for place_map in places:
        _add_corrected(found, place_map)
    report = numbers(found)
    if folder is not None:
        for lane in lanes:
            summary = summarise(log, lane, selection, truth, found.complete, found.warnings)
            if lane.folder is not None:
                lane.folder.write_summary(summary)
        write_report(found, report, folder)
    if course.error is not None:
        raise course.error
    return ComparisonResult(report, folder, found)


def _add_corrected(found: Comparison, places: "PlaceMap") -> None:
    """Add the first run with loops closed, and the lines of the loops."""
    first = found.runs[0]
    if places.problem:
        found.warnings.append(places.problem)
    elif len(first):
        found.runs.insert(1, first.with_poses(f"{first.name}-loops", places.corrected(first.trajectory())))
        _, positions_m, joined = places.lines()
        found.loops = positions_m[joined]


def outputs(folder: Path, methods: Sequence[str]) -> list[Path]:
    """All files that a comparison writes."""
    results = [folder / _key(method) / name for method in methods for name in RESULTS]
    return [*results, *(folder / name for name in REPORT)]


def _key(method: str) -> str:
    """The folder of a method."""
    return method.replace("-", "_")
