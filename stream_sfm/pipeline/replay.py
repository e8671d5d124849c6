"""Replays a log: its frames through the engine into sinks, then a summary. What was computed is never lost.

Ctrl-C, SIGTERM and SIGHUP end a replay after the current frame; a log that breaks off, a full disk or a defect end it
where they occur. In each case the estimates so far are written, and summary.json says `complete: false` and why.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.rig import MonoRig, StereoRig
from ..config import Config
from ..engine import Engine
from ..errors import FrameError, InputError, LogError
from ..evaluation.association import check_rigid, checked_ranges, without_frames
from ..frontend.prepared import PreparedImages
from ..interrupts import Interruption, deferred_interrupts
from ..outputs import RESULTS, refuse_overwriting
from ..recording import RecordedFrame, StereoLog, open_log
from ..report.records import CalibrationError
from ..report.run_page import render_run
from ..results.folder import ResultFolder, close_all
from ..types import Selection, Sink, Trajectory
from .calibration import CalibrationSink
from .prefetch import PreparedFrames, prepared_ahead
from .refine import calibration_error, refined_for_itself
from .self_test import SelfTest
from .statistics import RunStatistics, Stopwatch, peak_rss_mib
from .structure import StructureSink, TrueDepth
from .summary import summarise
from .there_and_back import TOO_MANY, KeptFrames, return_error, then_backwards


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ReplayResult:
    """The result of a replay: `summary` as in summary.json, `out_dir` (None: nothing was written), all poses."""

    summary: dict[str, Any]
    out_dir: Path | None
    trajectory: Trajectory

    @property
    def problems(self) -> list[str]:
        """Why the results cannot be trusted at all; empty for an ordinary run."""
        problems: list[str] = self.summary["problems"]
        return problems

    def __repr__(self) -> str:
        return f"<ReplayResult {self.summary['log']}: {self.trajectory!r}, written to {self.out_dir}>"


class ReplayInterrupted(KeyboardInterrupt):
    """A replay was ended by Ctrl-C, SIGTERM or SIGHUP; `result` holds what was estimated and written until then."""

    def __init__(self, result: ReplayResult) -> None:
        super().__init__("replay interrupted")
        self.result = result


def replay(
    log: str | Path | StereoLog,
    out_dir: str | Path | None = None,
    config: Config | None = None,
    selection: Selection | None = None,
    *,
    left: str | None = None,
    right: str | None = None,
    calibration: str | Path | StereoRig | MonoRig | None = None,
    there_and_back: bool = False,
    ignore_ground_truth: Sequence[tuple[int, int]] = (),
    calibrate: bool = False,
    self_test: bool = False,
    std_truth: tuple[float, float] = (0.0, 0.0),
    sinks: Sequence[Sink] = (),
) -> ReplayResult:
    """Estimate the selected frames of a log and write the results to `out_dir` (None: nowhere).

    `left`, `right`, `calibration`: as in `open_log`. `there_and_back`: then the same frames backwards; how far the
    run ends from its start is in the summary. `ignore_ground_truth`: ranges [first, end) of frames of this run whose
    ground truth is not compared, because it is wrong. `calibrate`: first learn from the same frames how the calibration
    errs, then estimate with what was learnt, from the first frame on. `self_test`: estimate from disjoint halves of the
    tracks, too, and tell in the summary how large their difference is in σ. `std_truth`: σ of the ground truth itself,
    in metres and radians. `sinks` are given each estimate and its frame after the files have been written, and are
    closed at the end. Memory grows by some 1500 bytes per frame, not with the images of the log; with `there_and_back`
    they are kept as recorded, up to a bound. Raises ConfigError, LogError where not one frame could be estimated,
    OutputError, ReplayInterrupted.
    """
    config = config or Config()
    if not isinstance(log, StereoLog):
        log = open_log(log, left, right, calibration, mono=config.mono)
    if out_dir is not None:
        refuse_overwriting([Path(out_dir) / name for name in RESULTS], [log.path])
    selection = selection or Selection()
    rig = refined_for_itself(log, config, selection) if calibrate else log.rig
    folder = None if out_dir is None else Path(out_dir)
    run = _Run(log, rig, config, selection, folder, sinks)
    run.ignored = checked_ranges(ignore_ground_truth)
    frames = log.frames(run.selection)
    run.std_truth = std_truth
    if self_test:
        config.needs_scale("the self-test")
        run.self_test = SelfTest(run.engine.observer.projection, config)
    if there_and_back:
        run.kept = KeptFrames()
        frames = then_backwards(frames, run.kept)
    with deferred_interrupts() as interruption:
        problem = run.feed(prepared_ahead(run.engine, frames), interruption)
        result = run.finish(problem, interruption.requested)
    if interruption.requested:
        raise ReplayInterrupted(result)
    if problem is not None:
        raise problem
    return result


class _Run:
    """One replay: the engine, the sinks that watch it, and what the summary says about its course."""

    def __init__(
        self,
        log: StereoLog,
        rig: StereoRig | MonoRig,
        config: Config,
        selection: Selection,
        out_dir: Path | None,
        sinks: Sequence[Sink],
    ) -> None:
        self.began_cpu_s = time.process_time()
        self.log, self.config, self.selection = log, config, selection
        self.rig = rig
        self.engine = Engine(rig, config)
        self.folder = None if out_dir is None else ResultFolder(out_dir, self.engine.rig, config)
        self.stopwatch = Stopwatch()
        self.statistics = RunStatistics(self.stopwatch)
        self.depth = TrueDepth(log)
        self.structure = None if config.mono else StructureSink(log.rig.left, self.depth)
        self.calibration = None if config.mono else CalibrationSink(log)
        own = (self.folder, self.statistics, self.structure, self.calibration)
        self.sinks: list[Sink] = [*(sink for sink in own if sink is not None), *sinks]
        self.kept: KeptFrames | None = None
        self.ignored: list[tuple[int, int]] = []
        self.self_test: SelfTest | None = None
        self.std_truth = (0.0, 0.0)
        self.truth_problem = ""
        self.compared_truth: Trajectory | None = None
        self.calibration_error: CalibrationError | None = None
        self.warnings: list[str] = []
        self.complete = True

    def feed(self, frames: PreparedFrames, interruption: Interruption) -> BaseException | None:
        """Take the frames one by one; return the exception that `replay` raises in the end, if there is one."""
        try:
            for frame, prepared in interruption.until_requested(self.stopwatch.frames(frames)):
                self.take(frame, prepared)
        except InputError as error:
            if not len(self.statistics):
                return error
            self.complete = False
            self.warnings.append(str(error))
        except BaseException as error:
            self.complete = False
            self.warnings.append(f"the run was ended by {type(error).__name__}: {error}")
            return error
        finally:
            frames.close()
        if not len(self.statistics) and self.statistics.refused:
            return LogError(f"{self.log.path}: no frame could be used: {self.statistics.first_refusal}")
        return None

    def take(self, frame: RecordedFrame, prepared: PreparedImages | None) -> None:
        """Pass one frame through the engine into all sinks."""
        try:
            estimate = self.engine.step(frame, prepared)
        except FrameError as error:
            self.statistics.refuse(error)
            return
        if self.self_test is not None and self.engine.observations is not None:
            self.self_test.add(self.engine.observations)
        for sink in self.sinks:
            if sink is not self.structure or not self._backwards([estimate.stamp_ns]):
                sink.write(estimate, frame)

    def _backwards(self, stamps_ns: Sequence[int]) -> int:
        """How many frames of these stamps are of the way back."""
        return 0 if self.kept is None else int(self.kept.are_backwards(np.array(stamps_ns, np.int64)).sum())

    def finish(self, problem: BaseException | None, interrupted: bool) -> ReplayResult:
        """Close the sinks and write the summary; a failure of these is raised unless `problem` comes first."""
        failure: Exception | None = None
        try:
            close_all(self.sinks)
        except Exception as error:
            failure = error
        trajectory = self.statistics.trajectory()
        summary = self._summary(trajectory, interrupted)
        if self.folder is not None:
            try:
                self.folder.write_summary(summary)
                there = len(trajectory) - summary["frames"]["backwards"]
                if there:
                    columns = self.statistics.columns(there)
                    page = render_run(summary, columns, self.compared_truth, self.calibration_error)
                    self.folder.write_page(page)
            except Exception as error:
                failure = failure or error
        if failure is not None and problem is None:
            raise failure
        return ReplayResult(summary, None if self.folder is None else self.folder.path, trajectory)

    def _problems(self, interrupted: bool) -> list[str]:
        """Why the results cannot be trusted at all: the wrong calibration, else no motion that was estimated."""
        if self.calibration is not None and self.calibration.problems:
            return self.calibration.problems
        problem = "" if interrupted else self.statistics.problem(one_wanted=self.selection.max_frames == 1)
        return [f"{self.log.path}: {p}" for p in (problem, self.truth_problem) if p]

    def _summary(self, trajectory: Trajectory, interrupted: bool) -> dict[str, Any]:
        further: dict[str, Any] = {
            "cpu_s": time.process_time() - self.began_cpu_s,
            "peak_rss_mib": peak_rss_mib(),
        }
        if interrupted:
            self.warnings.append(f"interrupted after {len(trajectory)} frames")
        truth = None
        try:
            truth = self.log.ground_truth() if len(trajectory) else None
        except InputError as error:
            self.warnings.append(f"ground truth is not compared: {error}")
        try:
            if truth is not None:
                check_rigid(truth)
        except InputError as error:
            truth, self.truth_problem = None, str(error)
        if truth is not None and not self.config.mono:
            self.compared_truth = without_frames(truth, trajectory.stamps_ns, self.ignored)
        if self.depth.problem:
            self.warnings.append(self.depth.problem)
        if self.statistics.rig is not None:
            self.calibration_error = calibration_error(self.engine.observer.projection, self.statistics.rig)
            further["rig"] = self.calibration_error.numbers
        if self.self_test is not None:
            further["self_test"] = self.self_test.result()
        if self.kept is not None:
            if self.kept.too_many:
                self.warnings.append(f"the frames were not fed backwards: {TOO_MANY}; select fewer frames")
            further["there_and_back"] = None if self.kept.too_many or interrupted else return_error(trajectory)
        projection = self.engine.observer.projection
        of_run = self.statistics.warnings(projection.f_px * projection.baseline_m)
        warnings = [*self.log.stats.warnings, *of_run, *self.warnings]
        further["problems"] = self._problems(interrupted)
        return summarise(
            self.log,
            self.config,
            self.selection,
            self.statistics,
            complete=self.complete and self.log.stats.complete and not interrupted,
            warnings=list(dict.fromkeys(warnings)),
            truth=truth,
            structure=None if self.structure is None else self.structure.comparison,
            std_truth=self.std_truth,
            backwards=self._backwards(self.statistics.stamps_ns),
            ignored=self.ignored,
            further=further,
        )
