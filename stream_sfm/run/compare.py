"""Compares methods on one log: a pass for observations and calibration errors, one with all methods, a report."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from ..camera.rig import StereoRig
from ..config import Config
from ..errors import ConfigError, require_study
from ..estimators import check_method
from ..evaluation.association import check_rigid, checked_ranges, without_frames
from ..logs.recording.pair_reader import ReadStats
from ..logs.recording.stereo_log import StereoLog, open_log
from ..methods import COMPARED, REFERENCE, REPLAYED, WITHOUT_IMU, key_of
from ..pipeline.observer import Observed, Observer
from ..report.calibration import describe
from ..report.drift import needs_halves
from ..report.numbers import numbers
from ..report.pages import REPORT, write_report
from ..report.records import AddedMotions, Comparison, FrontRecord, HalvesRecord, Truth
from ..results.folder import close_all
from ..system.blas import one_thread
from ..system.interrupts import deferred_interrupts
from ..system.outputs import RESULTS, refuse_overwriting
from ..types import FrameEstimate, Selection, Sink
from .lane import Lane
from .loop import Check, RunOutcome, run
from .needles import NeedlesOfFrame
from .self_test import MOST_FRAMES, Halves, SelfTest
from .stored import StoredObservations
from .summary import summarise

if TYPE_CHECKING:
    from ..places.place_map import PlaceMap


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
    methods: Sequence[str] | None = None,
    left: str | None = None,
    right: str | None = None,
    calibration: str | Path | StereoRig | None = None,
    as_is: bool = False,
    ignore_ground_truth: Sequence[tuple[int, int]] = (),
    inspection: dict[str, Any] | None = None,
    self_test: bool = False,
    loops: bool = False,
    std_truth: tuple[float, float] | None = None,
    sinks: Sequence[Sink] = (),
    on_frame: Callable[[], None] = lambda: None,
) -> ComparisonResult:
    """Run several methods on the selected frames of a log and write results and report to `out_dir` (None: nowhere).

    The first pass observes all frames and finds the calibration errors with the window. The second gives all
    methods, the window included, the same observations without these errors from the first frame on, as if the
    calibration were exact. The window of the first pass is a row of its own, as in a replay. With `rig.exact`
    no errors are sought. `as_is`: each method uses the calibration of the log instead, and estimates its errors itself
    if it can; the window then has two rows: its poses, and its newest motions added up.

    `left`, `right`, `calibration`: as in `open_log`. `methods`: names of METHODS, each with its own folder; None:
    those of `compared_on`. `ignore_ground_truth`: ranges [first, end) of frames of this run whose ground truth is
    not compared. `inspection`: the result of `inspect_log`, for the report. `self_test`, `std_truth`: as in
    `replay`. `sinks` get the estimates of the first method, for which images are read a second time, and are closed
    at the end. `on_frame` is called after each frame of each pass. `loops`: also show the first method with closed
    loops, which needs the extra map. An interruption ends the first pass, and the observations so far are still
    estimated; a second one ends that. Raises LogError if no frame can be read, ConfigError, OutputError.
    """
    config, selection = config or Config(), selection or Selection()
    config.needs_scale("compare")
    require_study("compare")
    _check_names(methods)
    ignored = checked_ranges(ignore_ground_truth)
    if not isinstance(log, StereoLog):
        log = open_log(log, left, right, calibration)
    truth = Truth(None, ignored, log.std_truth if std_truth is None else std_truth)
    methods = methods or compared_on(log, config)
    folder = None if out_dir is None else Path(out_dir)
    if folder is not None:
        refuse_overwriting(outputs(folder, methods), [log.path])
    found = _begun(log, config, truth, inspection or {}, as_is)
    with closing(_Comparing(log, selection, methods, folder, found)) as comparing:
        return comparing.run(self_test, loops, sinks, _Counter(on_frame))


def _check_names(methods: Sequence[str] | None) -> None:
    """Raise ConfigError where methods are named that there are not, or none of them."""
    if methods is not None and not methods:
        raise ConfigError("no method is named: give those to compare, such as cross-frame and ekf")
    for name in methods or ():
        check_method(name)


def _begun(log: StereoLog, config: Config, truth: Truth, inspection: dict[str, Any], as_is: bool) -> Comparison:
    """Return what is known of a comparison before its first frame, with the poses of the ground truth."""
    if (poses := log.ground_truth()) is not None:
        check_rigid(poses)
    return Comparison(
        log=log.path.absolute().name,  # so that "." has a name as well
        rig=log.stereo_rig,
        config=config,
        runs=[],
        front=FrontRecord(),
        truth=truth._replace(poses=poses),
        inspection=inspection,
        as_is=as_is,
    )


class _Comparing:
    """The passes of a comparison, which fill in `found`."""

    def __init__(
        self, log: StereoLog, selection: Selection, methods: Sequence[str], folder: Path | None, found: Comparison
    ) -> None:
        self._log, self._selection, self._folder, self._found = log, selection, folder, found
        self._depth, config = log.depth_images(), found.config
        of_rig = config.rig if found.as_is else msgspec.structs.replace(config.rig, exact=True)
        of_methods = [msgspec.structs.replace(config, method=name, rig=of_rig) for name in methods]
        with one_thread:
            observer = Observer(log.stereo_rig, config)
            self._finder = Lane(msgspec.structs.replace(config, method=REFERENCE), observer, None, None)
            reporting = observer if found.as_is else Observer(log.stereo_rig, of_methods[0])
            self._lanes = [
                Lane(c, reporting, self._depth, folder and folder / key_of(c.method), True) for c in of_methods
            ]
        self._stored = StoredObservations(self._finder)
        self._needles = NeedlesOfFrame(observer, (selection.count(log.expected_frames) or 0) // 2)

    def close(self) -> None:
        """Remove what is stored."""
        self._stored.close()

    def run(self, self_test: bool, loops: bool, sinks: Sequence[Sink], counter: "_Counter") -> ComparisonResult:
        """Make all passes, and write the report."""
        found, lanes, log = self._found, self._lanes, self._log
        tests = [SelfTest(self._finder.observer.projection, lanes[0].config)] if self_test else []
        added = [AddedMotions()] if found.as_is and any(lane.config.method == REFERENCE for lane in lanes) else []
        places: list[PlaceMap] = []
        if loops:
            from ..places import place_map  # as in a replay

            places = [place_map.PlaceMap(log.stereo_rig, lanes[0].config, wait=True)]
        outcome = self._observe(counter)
        if outcome.error is not None and not outcome.frames:
            raise outcome.error
        stats = log.stats
        self._estimate(outcome, [*places, *sinks], [found.front, *tests, *added, counter])
        self._fill_in(outcome, stats, added, places)
        found.self_test = next((test.result() for test in tests), None)
        if not found.interrupted and needs_halves(found):
            found.halves = self._halves()
        report = numbers(found)
        if self._folder is not None:
            for lane in lanes:
                summary = summarise(log, stats, lane, self._selection, found.truth, found.complete, found.warnings)
                if lane.folder is not None:
                    lane.folder.write_summary(summary)
            write_report(found, report, self._folder)
        if outcome.error is not None:
            raise outcome.error
        return ComparisonResult(report, self._folder, found)

    def _observe(self, counter: "_Counter") -> RunOutcome:
        """Make the first pass: all observations, and the calibration errors."""
        checks = (self._stored, self._needles, counter)
        with deferred_interrupts() as interruption:
            return run(
                self._log,
                self._finder,
                (self._needles,),
                checks,
                selection=self._selection,
                interruption=interruption,
                to_end=True,
            )

    def _observed(self) -> Iterator[Observed]:
        """Yield the observations for the methods."""
        return iter(self._stored) if self._found.as_is else self._stored.calibrated(self._finder.observer)

    def _estimate(self, outcome: RunOutcome, sinks: Sequence[Sink], checks: Sequence[Check]) -> None:
        """Make the second pass: all methods side by side on the observations."""
        lanes, frames = self._lanes, iter(self._log.frames(self._selection) if sinks else ())
        first = lanes[0].record.name
        for lane in lanes:
            lane.record.refused = self._finder.record.refused
            lane.record.first_refusal = self._finder.record.first_refusal
        observed_frames, outcome.frames = outcome.frames, 0
        try:
            with deferred_interrupts() as interruption, ThreadPoolExecutor(os.cpu_count()) as pool:
                for observed in interruption.until_requested(self._observed()):
                    estimates = _taken(observed, lanes, pool)
                    outcome.frames += 1
                    for check in checks:
                        check.add(observed, estimates)
                    if sinks and first in estimates:
                        stamp_ns = observed.observations.stamp_ns
                        frame = next(frame for frame in frames if frame.stamp_ns == stamp_ns)
                        for sink in sinks:
                            sink.write(estimates[first], frame)
                    if not estimates:
                        break
        except BaseException as error:
            outcome.end(error)
        if outcome.frames < observed_frames and interruption.requested:
            outcome.interrupt()
        with outcome.deferred_error():
            close_all([*(lane.folder for lane in lanes if lane.folder is not None), *sinks])

    def _fill_in(
        self, outcome: RunOutcome, stats: ReadStats, added: Sequence[AddedMotions], places: "Sequence[PlaceMap]"
    ) -> None:
        """Add the findings of both passes, and the poses of the first method as corrected by its map."""
        found, rig = self._found, self._finder.record.rig
        warnings = [*stats.warnings, self._depth.problem, *map(str, self._stored.changes), *outcome.warnings]
        warnings += [place_map.problem for place_map in places]
        found.warnings = list(dict.fromkeys(filter(None, warnings)))
        found.complete, found.interrupted = stats.complete and outcome.complete, outcome.interrupted
        observer = self._finder.observer
        found.calibration = None if rig is None else describe(observer.projection, rig, observer.state.rows)
        found.runs, found.needles = [lane.record for lane in self._lanes], self._needles.found
        if found.truth.poses is not None:
            stamps_ns = max(found.runs, key=len).stamps_ns
            poses = without_frames(found.truth.poses, stamps_ns, found.truth.ignored)
            found.truth = found.truth._replace(poses=poses)
        if not found.as_is and not found.config.rig.exact and self._finder.error is None:
            names = [record.name for record in found.runs]
            if REFERENCE in names:  # the first pass is a replay
                found.runs.insert(names.index(REFERENCE) + 1, self._finder.record.named(REPLAYED))
        for motions in added:
            at = next(k for k, record in enumerate(found.runs) if record.name == REFERENCE)
            if len(record := found.runs[at]):
                found.runs.insert(at + 1, record.with_poses(f"{record.name}-added", motions.trajectory()))
        first = found.runs[0]
        for place_map in places:
            if len(first) and not place_map.problem:
                corrected = place_map.corrected(first.trajectory())
                found.runs.insert(1, first.with_poses(f"{first.name}-loops", corrected))
                _, positions_m, joined = place_map.lines()
                found.loops = positions_m[joined]

    def _halves(self) -> dict[str, HalvesRecord]:
        """Make a third pass: each method on halves of the tracks."""
        projection = self._finder.observer.projection
        with one_thread, ThreadPoolExecutor(os.cpu_count()) as pool:
            halves = [Halves(projection, lane.config) for lane in self._lanes if lane.error is None]
            for observed in islice(self._observed(), MOST_FRAMES):
                wait([pool.submit(half.take, observed.observations) for half in halves])
        return {half.method: half.record for half in halves if not half.failed}


class _Counter:
    """A check that only counts frames."""

    def __init__(self, on_frame: Callable[[], None]) -> None:
        self._on_frame = on_frame

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        self._on_frame()


def _taken(observed: Observed, lanes: Sequence[Lane], pool: ThreadPoolExecutor) -> dict[str, FrameEstimate]:
    """Return the estimate of a frame by each lane that has not failed. Slow methods start first."""
    with one_thread:
        coming = {lane: pool.submit(lane.take, observed) for lane in sorted(lanes, key=lambda lane: -lane.spent_s)}
        wait(coming.values())  # wait for all of them, even if one raises
        found = {lane.record.name: coming[lane].result() for lane in lanes}
    return {name: estimate for name, estimate in found.items() if estimate is not None}


def compared_on(log: StereoLog, config: Config) -> tuple[str, ...]:
    """Return the methods that are compared by default; with inertial samples, also the window without them."""
    if log.imu_topics is None or log.stereo_rig.imu is None or not config.imu.enabled:
        return COMPARED
    return (REFERENCE, WITHOUT_IMU, *(name for name in COMPARED if name != REFERENCE))


def outputs(folder: Path, methods: Sequence[str]) -> list[Path]:
    """Return the files that a comparison writes."""
    results = [folder / key_of(method) / name for method in methods for name in RESULTS]
    return [*results, *(folder / name for name in REPORT)]
