"""Replays a log: a run with one lane, and its summary. Computed results are never lost."""

import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from ..camera.rig import MonoRig, StereoRig
from ..config import Config
from ..errors import ConfigError, InputError, require_study
from ..evaluation.association import check_rigid, checked_ranges, without_frames
from ..evaluation.summary import evaluate
from ..inspection.calibration_check import CalibrationSink
from ..logs.recording.stereo_log import StereoLog, open_log
from ..methods import METHODS
from ..pipeline.observer import Observer
from ..record import record
from ..report.calibration import describe
from ..report.records import RunRecord, Truth
from ..report.verdict import rows_warning
from ..system.blas import one_thread
from ..system.interrupts import Interruption, deferred_interrupts
from ..system.outputs import GRAVITY_TRAJECTORY, MAP_TRAJECTORY, RESULTS, TRAJECTORIES, refuse_overwriting
from ..types import Frame, FrameEstimate, InertialEstimator, Selection, Sink, Trajectory
from .lane import Lane
from .loop import RunOutcome, run
from .summary import peak_rss_mib, summarise

if TYPE_CHECKING:
    from ..places.place_map import PlaceMap
    from .self_test import SelfTestOfRun


@record
class ReplayResult:
    """The result of a replay: `summary` as in summary.json, `out_dir` (None: nothing was written), all poses.

    `in_gravity`: the same poses, with covariances, in a world whose z axis is up; None without `ros.gravity`.
    """

    summary: dict[str, Any]
    out_dir: Path | None
    trajectory: Trajectory
    in_gravity: Trajectory | None = None

    @property
    def problems(self) -> list[str]:
        """The reasons why the results cannot be trusted at all; empty for a normal run."""
        problems: list[str] = self.summary["problems"]
        return problems

    def __repr__(self) -> str:
        return f"<ReplayResult {self.summary['log']}: {self.trajectory!r}, written to {self.out_dir}>"


@runtime_checkable
class MapSink(Protocol):
    """A sink that shows the map of a run, if there is one: it is closed after the map, and can then read it."""

    def show_map(self, places: "PlaceMap") -> None:
        """Take the map, before the first frame."""
        ...


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
    ignore_ground_truth: Sequence[tuple[int, int]] = (),
    self_test: bool = False,
    there_and_back: bool = False,
    loops: bool = False,
    known_map: str | Path | None = None,
    save_map: str | Path | None = None,
    std_truth: tuple[float, float] | None = None,
    sinks: Sequence[Sink] = (),
) -> ReplayResult:
    """Estimate the selected frames of a log and write the results to `out_dir` (None: nowhere).

    `left`, `right`, `calibration`: as in `open_log`. `ignore_ground_truth`: ranges [first, end) of frames of this
    run whose ground truth is not compared, because it is wrong. `self_test`: also estimate from disjoint halves of
    the tracks, and report their difference in σ, with the calibration errors that each half finds and with those
    that the run has found. `there_and_back`: also estimate the frames backwards, and report the distance between
    start and end. `loops`: recognise places beside the engine, and write the corrected poses, trajectory_map.tum;
    so do `known_map`, the file of a map in which the camera is located, and `save_map`, a file for the map at the
    end. `std_truth`: σ of the ground truth itself, in metres and radians (None: as known of its data set). `sinks`
    get each estimate and its frame after the files have been written, and are closed at the end. Memory grows by some
    1500 bytes per frame, not with the images. Raises ConfigError, LogError if not one frame could be estimated,
    OutputError, ReplayInterrupted.
    """
    config, selection = config or Config(), selection or Selection()
    if self_test or there_and_back:
        config.needs_scale("the self-test" if self_test else "there and back")
    if config.mono:
        require_study("one camera")
    ignored = checked_ranges(ignore_ground_truth)
    if not isinstance(log, StereoLog):
        log = open_log(log, left, right, calibration, mono=config.mono)
    truth = Truth(None, ignored, log.std_truth if std_truth is None else std_truth)
    with_map = loops or known_map is not None or save_map is not None
    folder, map_file = (None if path is None else Path(path) for path in (out_dir, save_map))
    written = [] if folder is None else [folder / name for name in (*RESULTS, *TRAJECTORIES)]
    refuse_overwriting([*written, *filter(None, [map_file])], [log.path])
    replayed = _Replay(log, config, selection, folder, self_test, there_and_back)
    if config.ros.gravity:
        _check_gravity(log, replayed.lane, with_map)
    if with_map:
        replayed.find_places(known_map, map_file, sinks)
    return replayed.run(sinks, truth)


def replay_with_lane(
    log: StereoLog, config: Config, selection: Selection, sinks: Sequence[Sink] = ()
) -> tuple[ReplayResult, Lane]:
    """Replay without files; also return the lane, with what its front-end has learnt. Raises as `replay`."""
    replayed = _Replay(log, config, selection, None, False, False)
    return replayed.run(sinks, Truth(None, checked_ranges(()), (0.0, 0.0))), replayed.lane


class _Replay:
    """The lane of a replay, its sinks and checks, and its result."""

    def __init__(
        self,
        log: StereoLog,
        config: Config,
        selection: Selection,
        folder: Path | None,
        self_test: bool,
        there_and_back: bool,
    ) -> None:
        self._began_cpu_s = time.process_time()
        self._log, self._config, self._selection = log, config, selection
        self._depth = None if config.mono else log.depth_images()
        with one_thread:
            observer = Observer(log.rig, config)
            self.lane = Lane(config, observer, self._depth, folder)
        self.checks = [_self_test(self.lane)] if self_test else []
        self._calibration = CalibrationSink(log)
        self._places: PlaceMap | None = None
        self._save_map: Path | None = None
        # Places maps if the calibration changes; not with one camera, as its unit of length would also change.
        self._there_and_back = there_and_back
        self.restarts = not (config.mono or self_test or there_and_back)
        self._latency = _Latency(log)
        self.sinks: list[Sink] = [self._latency] if config.mono else [self._calibration, self._latency]

    def find_places(self, known: str | Path | None, save: Path | None, sinks: Sequence[Sink]) -> None:
        """Make a map beside the estimates, starting from the file `known` if given."""
        from ..places.place_map import PlaceMap  # late, as few runs need OpenCV's features and GTSAM

        places = PlaceMap(self._log.rig, self._config, wait=True, known=known)
        self._places, self._save_map = places, save
        self.restarts = False
        self.sinks.append(places)
        if self.lane.folder is not None:
            self.lane.folder.map_from_world = lambda: places.world_from_odom
        for sink in sinks:
            if isinstance(sink, MapSink):
                sink.show_map(places)

    def run(self, sinks: Sequence[Sink], truth: Truth) -> ReplayResult:
        """Do the run and write its results. Raises what ended it early."""
        with deferred_interrupts() as interruption:
            outcome = run(
                self._log,
                self.lane,
                [*self.sinks, *sinks],
                self.checks,
                selection=self._selection,
                interruption=interruption,
                all_calibrations=self.restarts,
            )
            result = self.result(outcome, truth, interruption)
        if interruption.requested:
            raise ReplayInterrupted(result)
        if outcome.error is not None:
            raise outcome.error
        return result

    def result(self, outcome: RunOutcome, truth: Truth, interruption: Interruption) -> ReplayResult:
        """Write the summary; a failure of this is the error of the outcome unless there is one already."""
        record, folder = self.lane.record, self.lane.folder
        if self.lane.error is not None:
            outcome.end(self.lane.error)
        truth, problems = self._with_poses(truth, outcome)
        if not outcome.interrupted and (problem := record.problem(one_wanted=self._selection.max_frames == 1)):
            problems.insert(0, f"{self._log.path}: {problem}")
        in_gravity = _upright_trajectory(record, outcome) if self._config.ros.gravity else None
        further = self._further(outcome, interruption) | {"problems": self._calibration.problems or problems}
        corrected = None
        if self._places is not None and len(record):
            corrected, further["map"] = self._corrected(self._places, outcome, truth)
        stats = self._log.stats
        complete, warnings = outcome.complete and stats.complete, [*stats.warnings, *outcome.warnings]
        if self._depth is not None and self._depth.problem:
            warnings.append(self._depth.problem)
        summary = summarise(self._log, stats, self.lane, self._selection, truth, complete, warnings, further)
        with outcome.deferred_error():
            if folder is not None:
                folder.write_summary(summary)
                for name, trajectory in ((MAP_TRAJECTORY, corrected), (GRAVITY_TRAJECTORY, in_gravity)):
                    if trajectory is not None:
                        folder.write_trajectory(name, trajectory)
        with outcome.deferred_error():
            if self._places is not None and self._save_map is not None and corrected is not None:
                self._places.save(self._save_map)
        return ReplayResult(summary, None if folder is None else folder.path, record.trajectory(), in_gravity)

    def _further(self, outcome: RunOutcome, interruption: Interruption) -> dict[str, Any]:
        """Return the rest of the summary: cost, latency, the rig, and the checks of this run."""
        record = self.lane.record
        further: dict[str, Any] = {"cpu_s": time.process_time() - self._began_cpu_s, "peak_rss_mib": peak_rss_mib()}
        if self._latency.ages_ms:
            further["live"] = self._latency.summary()
        if record.rig is not None:
            observer = self.lane.observer
            further["rig"] = describe(observer.projection, record.rig, observer.state.rows)
            outcome.warnings += filter(None, [rows_warning(observer.state.rows)])
        for test in self.checks:
            with closing(test):
                further["self_test"] = test.result(interruption)
        if self._there_and_back and not outcome.interrupted and len(record):
            from .there_and_back import drift_there_and_back

            there, further["there_and_back"] = record.trajectory(), None
            try:  # estimates are not lost if the way back fails
                back = drift_there_and_back(self._log, self._config, self._selection, there, interruption)
                further["there_and_back"] = back
            except (ConfigError, InputError) as error:
                outcome.warnings.append(f"there and back: {error}")
        return further

    def _corrected(
        self, places: "PlaceMap", outcome: RunOutcome, truth: Truth
    ) -> tuple[Trajectory | None, dict[str, Any]]:
        """Return the poses of the run in the world of its map, None if the map has failed, and its findings."""
        found: dict[str, Any] = {"keyframes": len(places), "loops": len(places.loops), "problem": places.problem}
        if places.problem:
            outcome.warnings.append(places.problem)
            return None, found
        corrected = places.corrected(self.lane.record.trajectory())
        if truth.poses is not None:
            found["ground_truth"] = evaluate(corrected, truth.poses)
        return corrected, found

    def _with_poses(self, truth: Truth, outcome: RunOutcome) -> tuple[Truth, list[str]]:
        """Return the truth with its poses at the frames of the run, and why they are refused, if so."""
        stamps_ns = self.lane.record.stamps_ns
        try:
            poses = self._log.ground_truth(int(stamps_ns[-1])) if len(stamps_ns) else None
        except InputError as error:
            outcome.warnings.append(f"ground truth is not compared: {error}")
            return truth, []
        if poses is None:
            return truth, []
        try:
            check_rigid(poses)
        except InputError as error:
            return truth, [f"{self._log.path}: {error}"]
        return truth._replace(poses=without_frames(poses, stamps_ns, truth.ignored)), []


def _self_test(lane: Lane) -> "SelfTestOfRun":
    from .self_test import SelfTestOfRun

    return SelfTestOfRun(lane)


def _check_gravity(log: StereoLog, lane: Lane, with_map: bool) -> None:
    """Raise a ConfigError if there are no samples to show which way is up."""
    config, why = lane.config, ""
    if with_map:
        why = "a map of places has a world of its own: leave out one of the two"
    elif config.mono or not isinstance(log.rig, StereoRig):
        why = "with one camera inertial samples are not used: use both cameras"
    elif not config.imu.enabled:
        why = "inertial samples are switched off: set imu.enabled to true"
    elif not (METHODS[config.method].inertial and isinstance(lane.estimator, InertialEstimator)):
        why = f"the method {config.method} takes no inertial samples: use cross-frame"
    elif log.imu_topics is None:
        why = log.imu_problem or f"{log.path} has no inertial samples: leave out the world of gravity"
    if why:
        raise ConfigError(f"the world cannot be made upright by gravity: {why}")


def _upright_trajectory(record: RunRecord, outcome: RunOutcome) -> Trajectory | None:
    """Return the poses of a run in a world that is upright by its last samples, and warn if there were none."""
    if record.upright is None:
        outcome.warnings.append("no frame had usable inertial samples: it is not known which way is up")
        return None
    known = record.trajectory()
    assert known.cov_pose is not None  # every record has it
    return Trajectory(known.stamps_ns, *record.upright.poses(known.world_from_cam, known.cov_pose))


class _Latency(Sink):
    """A sink that records the age of the images of a live camera when their estimates have been written."""

    def __init__(self, log: StereoLog) -> None:
        self._log = log
        self.ages_ms: list[float] = []

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Record the age of the images of a frame."""
        if (age_s := self._log.age_s(frame.stamp_ns)) is not None:
            self.ages_ms.append(1e3 * age_s)

    def summary(self) -> dict[str, Any]:
        """Return `latency_ms` from image to estimate, and the number of skipped pairs, `left_out`."""
        p50, p99, most = np.percentile(self.ages_ms, [50, 99, 100]).tolist()
        return {"latency_ms": {"p50": p50, "p99": p99, "max": most}, "left_out": self._log.left_out}
