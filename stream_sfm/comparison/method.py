"""Runs one method of a comparison: the shared observations through its estimator into its record and its folder."""

import time
from pathlib import Path

import msgspec
import numpy as np

from ..config import Config
from ..estimators import make_estimator
from ..observer import Observed, Observer
from ..pipeline.statistics import RunStatistics
from ..pipeline.structure import StructureSink, TrueDepth
from ..pipeline.summary import summarise
from ..recording import RecordedFrame, StereoLog
from ..report.records import Comparison, MethodRun
from ..results.folder import ResultFolder
from ..types import FrameEstimate, Observations, RigEstimate, Selection, Sink, Solution


class ComparedMethod:
    """One method: its estimator, the sinks that watch it, and its record for the report.

    If the estimator fails, the method ends there, `record.failure` says why, and the other methods go on.
    """

    def __init__(
        self, name: str, observer: Observer, config: Config, depth: TrueDepth, folder: Path | None
    ) -> None:
        self.name = name
        self.record = MethodRun(name)
        self.statistics = RunStatistics()
        self._observer = observer
        self._config = msgspec.structs.replace(config, method=name)
        self._estimator = make_estimator(name, observer.projection, self._config)
        self.rig: RigEstimate | None = None  # what the method has told of the rig's errors, the latest
        self.rig_px: RigEstimate | None = None  # the same in pixels
        self._structure = StructureSink(observer.rig.left, depth)
        self._folder = None
        if folder is not None:
            self._folder = ResultFolder(folder / self.record.key, observer.rig, self._config)
        sinks = (self._folder, self.statistics, self._structure)
        self.sinks: list[Sink] = [sink for sink in sinks if sink is not None]

    def take(self, observed: Observed, frame: RecordedFrame) -> FrameEstimate | None:
        """Estimate a frame, and pass the estimate to all sinks; None if the method has failed, now or before."""
        solved = self._solve(observed)
        if solved is None:
            return None
        solution, estimate = solved
        self.rig, self.rig_px = solution.rig or self.rig, estimate.rig or self.rig_px
        self.record.add(estimate)
        self.record.reprojection_px.append(self._reprojection_px(solution, observed.observations))
        for sink in self.sinks:
            sink.write(estimate, frame)
        errors = self._structure.latest
        if errors is not None and len(errors.errors_m):
            rms_m, sigma_m = (float(np.sqrt((x**2).mean())) for x in (errors.errors_m, errors.sigmas_m))
            self.record.depth_rows.append((estimate.frame_index, rms_m, sigma_m))
        return estimate

    def take_backwards(self, observed: Observed) -> None:
        """Estimate a frame of the way back; only its pose is kept."""
        solved = self._solve(observed, " (on the way back)")
        if solved is not None:
            self.record.back.append(solved[1].world_from_cam)

    def finished_record(self) -> MethodRun:
        """Return the record with the errors of the local structure, if all depth images could be read."""
        self.record.structure = self._structure.comparison
        return self.record

    def write_summary(self, log: StereoLog, selection: Selection, comparison: Comparison) -> None:
        """Write summary.json to the method's folder. Raises OutputError."""
        if self._folder is None:
            return
        failure = self.record.failure
        projection = self._observer.projection
        of_run = self.statistics.warnings(projection.f_px * projection.baseline_m)
        summary = summarise(
            log,
            self._config,
            selection,
            self.statistics,
            complete=comparison.complete and not failure,
            # a knock is of the frames that all methods share, and of each method's run
            warnings=list(dict.fromkeys([*comparison.warnings, *of_run, *([failure] if failure else [])])),
            truth=comparison.truth,
            structure=self.record.structure,
            ignored=comparison.ignored,
            std_truth=comparison.std_truth,
        )
        self._folder.write_summary(summary)

    def _solve(self, observed: Observed, where: str = "") -> tuple[Solution, FrameEstimate] | None:
        if self.record.failure:
            return None
        began_s = time.perf_counter()
        try:
            solution = self._estimator.step(observed.observations)
        except np.linalg.LinAlgError as error:
            self.record.failure = f"stopped at frame {observed.observations.frame_index}{where}: {error}"
            return None
        estimator_ms = 1e3 * (time.perf_counter() - began_s)
        return solution, self._observer.estimate(observed, solution, estimator_ms)

    def _reprojection_px(self, solution: Solution, observations: Observations) -> float:
        """Return the RMS residual of the current views against the current points, pixels; NaN without points."""
        rows = np.flatnonzero(np.isin(observations.track_ids, solution.track_ids))
        points = solution.points_in_cam[np.isin(solution.track_ids, observations.track_ids)]
        front = points[:, 2] > 1e-3
        if not front.any():
            return float("nan")
        residuals = observations.z_px[rows[front]] - self._observer.projection.project(points[front])
        return float(np.sqrt(np.nanmean(residuals**2)))
