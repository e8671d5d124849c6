"""Compares methods on one log in one pass: the front-end does not depend on the method, so it runs once.

log -> observer -> the same observations for the estimator of every method -> a result folder each, and the report.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.rig import StereoRig
from ..config import Config
from ..errors import FrameError, InputError
from ..estimators import check_method
from ..evaluation.association import check_rigid, checked_ranges, without_frames
from ..frontend.prepared import PreparedImages
from ..interrupts import Interruption, deferred_interrupts
from ..observer import Observed, Observer
from ..outputs import RESULTS, refuse_overwriting
from ..pipeline.prefetch import prepared_ahead
from ..pipeline.refine import calibration_error, refined_for_itself
from ..pipeline.self_test import SelfTest
from ..pipeline.statistics import Stopwatch
from ..pipeline.structure import TrueDepth
from ..pipeline.there_and_back import TOO_MANY, KeptFrames
from ..recording import RecordedFrame, StereoLog, open_log
from ..report.numbers import numbers
from ..report.page import REPORT, write_report
from ..report.records import CalibrationError, Comparison, MethodRun
from ..results.folder import close_all
from ..types import FrameEstimate, RigEstimate, Selection, Sink, Trajectory
from .method import ComparedMethod
from .recorder import Recorder

COMPARED = (
    "cross-frame",
    "cross-frame-wc",
    "cross-frame-cc",
    "ekf",
    "iterated-ekf",
    "ekf-cv",
    "frame-to-frame",
)


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
    there_and_back: bool | None = None,
    ignore_ground_truth: Sequence[tuple[int, int]] = (),
    inspection: dict[str, Any] | None = None,
    calibrate: bool = False,
    self_test: bool = False,
    std_truth: tuple[float, float] = (0.0, 0.0),
    sinks: Sequence[Sink] = (),
) -> ComparisonResult:
    """Run several methods on the selected frames of a log and write results and report to `out_dir` (None: nowhere).

    `left`, `right`, `calibration`: as in `open_log`. `methods`: names of METHODS, each with a folder of its own.
    `there_and_back`: feed the frames backwards after the last one; None: only where the log has no ground truth.
    `ignore_ground_truth`: ranges [first, end) of frames of this run whose ground truth is not compared.
    `inspection`: what `inspect_log` found, for the report. `calibrate`, `self_test`, `std_truth`: as in `replay`.
    The errors of the calibration that the window finds are taken out of the views of the other methods too,
    so that methods are compared and not calibrations. `sinks` are given one estimate per frame, of the first method
    that has not failed, and are closed at the end. Raises LogError where no frame can be read, ConfigError for
    an unknown method, OutputError.
    """
    config = config or Config()
    config.needs_scale("compare")
    for name in methods:
        check_method(name)
    if not isinstance(log, StereoLog):
        log = open_log(log, left, right, calibration)
    folder = None if out_dir is None else Path(out_dir)
    if folder is not None:
        refuse_overwriting(outputs(folder, methods), [log.path])
    ignored = checked_ranges(ignore_ground_truth)
    selection = selection or Selection()
    rig = refined_for_itself(log, config, selection) if calibrate else log.stereo_rig
    run = _Run(log, rig, config, methods, selection, folder, sinks)
    run.self_test = SelfTest(run.observer.projection, config) if self_test else None
    truth = log.ground_truth()
    if truth is not None:
        check_rigid(truth)
    back = truth is None if there_and_back is None else there_and_back
    with deferred_interrupts() as interruption:
        kept = KeptFrames() if back else None
        run.forwards(kept, interruption)
        note = "not done: the log has ground truth" if kept is None else run.backwards(kept, interruption)
    comparison = run.result(truth, ignored, inspection or {}, note, interruption.requested)
    comparison = replace(comparison, std_truth=std_truth)
    if folder is None:
        return ComparisonResult(numbers(comparison), None, comparison)
    for method in run.methods:
        method.write_summary(log, run.selection, comparison)
    return ComparisonResult(write_report(comparison, folder), folder, comparison)


def outputs(folder: Path, methods: Sequence[str]) -> list[Path]:
    """All files that a comparison writes."""
    results = [folder / MethodRun(method).key / name for method in methods for name in RESULTS]
    return [*results, *(folder / name for name in REPORT)]


class _Run:
    """One comparison: the observer, the methods that share its observations, and the records for the report."""

    def __init__(
        self,
        log: StereoLog,
        rig: StereoRig,
        config: Config,
        methods: Sequence[str],
        selection: Selection,
        folder: Path | None,
        sinks: Sequence[Sink],
    ) -> None:
        self.log, self.config, self.selection, self.sinks = log, config, selection, sinks
        self.rig = rig
        self.observer = Observer(rig, config)
        self.self_test: SelfTest | None = None
        self.recorder = Recorder(self.observer)
        self.depth = TrueDepth(log)
        self.methods = [ComparedMethod(name, self.observer, config, self.depth, folder) for name in methods]
        self.stopwatch = Stopwatch()
        self.frames = 0
        self.problems: list[str] = []

    def forwards(self, kept: KeptFrames | None, interruption: Interruption) -> None:
        """Take the frames one by one until the log ends or the run is interrupted; then close the sinks."""
        frames = prepared_ahead(self.observer, self.log.frames(self.selection))
        try:
            for frame, prepared in interruption.until_requested(self.stopwatch.frames(frames)):
                self.take(frame, prepared)
                if kept is not None:
                    kept.keep(frame)
            if interruption.requested:
                self.problems.append(f"interrupted after {self.frames} frames")
        except InputError as error:
            if not self.frames:
                raise
            self.problems.append(str(error))
        finally:
            frames.close()
            close_all([*(sink for method in self.methods for sink in method.sinks), *self.sinks])

    def take(self, frame: RecordedFrame, prepared: PreparedImages | None) -> None:
        """Pass one frame through the observer, and its observations through all methods."""
        try:
            observed = self.observer.observe(frame, prepared)
        except FrameError as error:
            for method in self.methods:
                method.statistics.refuse(error)
            return
        observed = replace(observed, timings_ms={"decode": 1e3 * self.stopwatch.waited_s} | observed.timings_ms)
        self.frames += 1
        estimates: dict[str, FrameEstimate] = {}
        if self.self_test is not None:
            self.self_test.add(observed.observations)
        for method in self.methods:
            estimate = method.take(self._for(method, observed), frame)
            if estimate is not None:
                estimates[method.name] = estimate
        self.recorder.take(observed, frame, estimates)
        for estimate in list(estimates.values())[:1]:
            for sink in self.sinks:
                sink.write(estimate, frame)

    def _for(self, method: ComparedMethod, observed: Observed) -> Observed:
        """The observations as a method gets them: without the errors of the rig, unless it finds them itself."""
        learnt = next((m.rig for m in self.methods if m.rig is not None), None)
        effects = observed.observations.rig_effects
        if method.rig is not None or learnt is None or not learnt.applied or effects is None:
            return observed
        z_px = observed.observations.z_px - effects @ learnt.mean
        return replace(observed, observations=replace(observed.observations, z_px=z_px))

    def _told(self) -> RigEstimate | None:
        """What the methods have told about the errors of the calibration, in pixels."""
        return next((m.rig_px for m in self.methods if m.rig_px is not None), None)

    def _calibration(self) -> CalibrationError | None:
        """What the methods have told about the calibration, in numbers and over the image."""
        told = self._told()
        return None if told is None else calibration_error(self.observer.projection, told)

    def backwards(self, kept: KeptFrames, interruption: Interruption) -> str:
        """Feed the frames backwards; return what the report says about it."""
        if self.problems:
            return f"not done: {self.problems[0]}"
        if kept.too_many:
            return f"not done: {TOO_MANY}"
        for frame in kept.backwards():
            observed = self.observer.observe(frame)
            for method in self.methods:
                method.take_backwards(self._for(method, observed))
            if interruption.requested:
                for method in self.methods:
                    method.record.back.clear()
                self.problems.append("interrupted on the way back")
                return f"not done: {self.problems[0]}"
        return f"{self.frames} frames there, {self.frames - 1} back"

    def result(
        self,
        truth: Trajectory | None,
        ignored: list[tuple[int, int]],
        inspection: dict[str, Any],
        return_note: str,
        interrupted: bool,
    ) -> Comparison:
        """Return all that the report is made of."""
        runs = [method.finished_record() for method in self.methods]
        if truth is not None and runs:
            longest = max(runs, key=lambda r: len(r.poses))
            stamps_ns = np.array(longest.stamps_ns, np.int64)
            truth = without_frames(truth, stamps_ns, ignored)
        warnings = [
            *self.log.stats.warnings,
            *([self.depth.problem] if self.depth.problem else []),
            *(str(change) for method in self.methods[:1] for change in method.statistics.rig_changes),
            *self.problems,
        ]
        return Comparison(
            log=self.log.path.name,
            rig=self.rig,
            self_test=None if self.self_test is None else self.self_test.result(),
            calibration=self._calibration(),
            config=self.config,
            runs=runs,
            front=self.recorder.front,
            truth=truth,
            ignored=ignored,
            inspection=inspection,
            local_difference=self.recorder.local_difference,
            warnings=list(dict.fromkeys(warnings)),
            complete=self.log.stats.complete and not self.problems,
            interrupted=interrupted,
            return_note=return_note,
        )
