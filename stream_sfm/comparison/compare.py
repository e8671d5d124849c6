"""All methods on one log in one pass: the front-end does not depend on the estimator, so it runs once.

log -> front-end -> the same observations to every estimator -> a result folder a method, and the drift report.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ..config import Config
from ..errors import ConfigError, InputError
from ..estimators import METHODS, make_estimator
from ..evaluation.structure import StructureComparison
from ..interrupts import signals_noted
from ..observer import Observed, Observer
from ..pipeline.replay import Sink
from ..pipeline.there_and_back import TOO_LONG, WayBack
from ..recording import StereoLog, StereoPair
from ..report.records import Comparison, FrontRecord, MethodRun, Snapshot
from ..report.thumbnails import jpeg
from ..types import Estimator, FrameEstimate, Observations, Solution, StereoFrame

COMPARED = ("cross-frame", "cross-frame-wc", "cross-frame-cc", "ekf", "ekf-cv", "frame-to-frame")
_SNAPSHOT_WIDTH = 560
_GAP = 1.6  # of the usual time between frames


@dataclass(frozen=True, slots=True)
class Selection:
    """Which frames of the log: seconds from the first, at most so many, every so manieth."""

    start_s: float | None = None
    end_s: float | None = None
    max_frames: int | None = None
    stride: int = 1


class _Runner:
    """One method: its estimator, its record, its sinks."""

    def __init__(self, name: str, estimator: Estimator, run: MethodRun, sinks: list[Sink]) -> None:
        self.name, self.estimator, self.run, self.sinks = name, estimator, run, sinks
        self.where = ""

    def solve(self, observations: Observations) -> tuple[Solution, float] | None:
        """The solution and seconds it took; None when the method has failed, now or before."""
        if self.run.failure:
            return None
        began = time.perf_counter()
        try:
            solution = self.estimator.step(observations)
        except np.linalg.LinAlgError as error:  # a defect of one method must not cost the others' results
            self.run.failure = f"stopped at frame {observations.frame_index}{self.where}: {error}"
            return None
        return solution, time.perf_counter() - began


def compare(
    log: StereoLog,
    config: Config,
    methods: Sequence[str] = COMPARED,
    selection: Selection | None = None,
    there_and_back: bool | None = None,
    make_sink: Callable[[str], list[Sink]] | None = None,
    inspection: dict[str, Any] | None = None,
    on_frame: Callable[[FrameEstimate], None] | None = None,
) -> Comparison:
    """Run `methods` on the log.

    `there_and_back`: feed the frames backwards after the last one; None: where the log has no ground truth.
    The sinks of `make_sink(method)` get each estimate of the way there, `on_frame` one method's estimate a frame.
    Raises LogError where no frame can be read, ConfigError for an unknown method.
    """
    config.needs_scale("compare")
    for name in methods:
        if name not in METHODS:
            raise ConfigError(f"method {name!r} is not known; known are {', '.join(METHODS)}")
    selection = selection or Selection()
    pass_ = _Pass(log, config, methods, make_sink or (lambda _: []))
    truth = log.ground_truth()
    back = truth is None if there_and_back is None else there_and_back
    way_back = WayBack() if back else None
    problems: list[str] = []
    with signals_noted() as signals:
        try:
            for pair, frame, seconds in _timed(log, selection):
                estimates = pass_.forward(frame, seconds)
                if way_back is not None:
                    way_back.keep(pair)
                if on_frame is not None and estimates:
                    on_frame(next(iter(estimates.values())))
                if signals:
                    problems.append(f"interrupted after {pass_.next_index} frames")
                    break
        except InputError as error:
            if not pass_.next_index:
                raise
            problems.append(str(error))
        finally:
            pass_.close()
    note = "not done: the log has ground truth"
    if way_back is not None:
        note = f"not done: {problems[0]}" if problems else pass_.way_back(way_back)
    return Comparison(
        log=Path(log.path).name,
        rig=log.stereo_rig,
        config=config,
        runs=[r.run for r in pass_.runners],
        front=pass_.front,
        truth=truth,
        inspection=inspection or {},
        local_difference=pass_.local_difference,
        warnings=list(dict.fromkeys([*log.stats.warnings, *problems])),
        complete=log.stats.complete and not problems,
        interrupted=bool(signals),
        return_note=note,
    )


def _timed(log: StereoLog, s: Selection) -> Iterator[tuple[StereoPair, StereoFrame, float]]:
    frames = log.decoded(s.start_s, s.end_s, s.max_frames, s.stride)
    while True:
        began = time.perf_counter()
        item = next(frames, None)
        if item is None:
            return
        yield *item, time.perf_counter() - began


class _Pass:
    """The state of one pass: a front-end, a runner a method, and what the report needs."""

    def __init__(
        self, log: StereoLog, config: Config, methods: Sequence[str], make_sink: Callable[[str], list[Sink]]
    ) -> None:
        self.observer = Observer(log.stereo_rig, config)
        self.front = FrontRecord()
        self.local_difference: list[tuple[int, float]] = []
        self._depths = log.depth_images()
        self.runners: list[_Runner] = []
        for name in methods:
            structure = StructureComparison(log.rig.left)
            method_config = msgspec.structs.replace(config, method=name)
            estimator = make_estimator(name, self.observer.projection, method_config)
            self.runners.append(_Runner(name, estimator, MethodRun(name, structure), make_sink(name)))
        self.next_index = 0
        self.stamps: list[int] = []
        self._previous: Observations | None = None

    def forward(self, frame: StereoFrame, decode_s: float) -> dict[str, FrameEstimate]:
        """One frame of the way there: the estimate of each method that goes on."""
        observed = self.observer.observe(frame)
        obs = observed.observations
        front = self.front
        front.decode_ms.append(1e3 * decode_s)
        front.rectify_ms.append(observed.timings_ms["rectify"])
        front.frontend_ms.append(observed.timings_ms["frontend"])
        front.add(obs)
        self._note_gap(frame.stamp_ns)
        observed = Observed(obs, {"decode": 1e3 * decode_s} | observed.timings_ms)
        depth = self._depths.at(frame.stamp_ns)
        local: dict[str, FrameEstimate] = {}
        for runner in self.runners:
            solved = runner.solve(obs)
            if solved is None:
                continue
            solution, seconds = solved
            estimate = self.observer.estimate(observed, solution, 1e3 * seconds)
            local[runner.name] = estimate
            runner.run.add(estimate)
            runner.run.reprojection_px.append(self._reprojection(solution, obs))
            for sink in runner.sinks:
                sink.write(estimate)
            if runner.run.structure is not None:
                found = runner.run.structure.add(estimate, depth)
                if found is not None and len(found.errors_m):
                    rms = [float(np.sqrt((x**2).mean())) for x in (found.errors_m, found.sigmas_m)]
                    runner.run.depth_rows.append((self.next_index, rms[0], rms[1]))
        self._compare_local(local)
        if front.wants_snapshot(self.next_index):
            front.keep(self._snapshot(obs, *self.observer.rectify(frame)))
        self._previous = obs
        self.next_index += 1
        return local

    def way_back(self, way_back: WayBack) -> str:
        """Feed the frames backwards; returns what to say about it."""
        if way_back.too_long:
            return f"not done: {TOO_LONG}"
        there = self.next_index
        for runner in self.runners:
            runner.where = " (on the way back)"
        for _, frame in way_back.frames():
            observed = self.observer.observe(frame)
            self.next_index += 1
            for runner in self.runners:
                solved = runner.solve(observed.observations)
                if solved is not None:
                    estimate = self.observer.estimate(observed, *solved)
                    runner.run.back.append(estimate.world_from_cam)
        return f"{there} frames there, {there - 1} back"

    def close(self) -> None:
        """Finish the sinks."""
        for runner in self.runners:
            for sink in runner.sinks:
                sink.close()

    def _note_gap(self, stamp_ns: int) -> None:
        self.stamps.append(stamp_ns)
        steps = np.diff(self.stamps[-50:])
        if len(steps) > 2 and steps[-1] > _GAP * np.median(steps):
            self.front.gaps.append(self.next_index)

    def _reprojection(self, solution: Solution, obs: Observations) -> float:
        """RMS residual, px, of the present views against the present points."""
        rows = np.flatnonzero(np.isin(obs.track_ids, solution.track_ids))
        points = solution.points_in_cam[np.isin(solution.track_ids, obs.track_ids)]
        front = points[:, 2] > 1e-3
        if not front.any():
            return float("nan")
        r = obs.z_px[rows[front]] - self.observer.projection.project(points[front])
        return float(np.sqrt(np.nanmean(r**2)))

    def _compare_local(self, local: dict[str, FrameEstimate]) -> None:
        """CC against WC-derived local structure: the same points in the same camera, by the two book-keepings."""
        cc, wc = local.get("cross-frame-cc"), local.get("cross-frame-wc")
        if cc is None or wc is None:
            return
        _, i, j = np.intersect1d(cc.track_ids, wc.track_ids, return_indices=True)
        if len(i):
            apart = np.linalg.norm(cc.points_in_cam[i] - wc.points_in_cam[j], axis=1)
            self.local_difference.append((self.next_index, float(np.median(apart))))

    def _snapshot(self, obs: Observations, left: np.ndarray, right: np.ndarray) -> Snapshot:
        temporal = np.empty((0, 4))
        if self._previous is not None:
            _, i, j = np.intersect1d(self._previous.track_ids, obs.track_ids, return_indices=True)
            temporal = np.concatenate([self._previous.z_px[i, :2], obs.z_px[j, :2]], axis=1)
        stereo = obs.z_px[np.isfinite(obs.z_px).all(axis=1)]
        images = [jpeg(image, _SNAPSHOT_WIDTH) for image in (left, right)]
        return Snapshot(obs.frame_index, (left.shape[1], left.shape[0]), images[0], images[1], stereo, temporal)
