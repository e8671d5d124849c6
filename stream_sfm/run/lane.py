"""A lane of a run: one estimator on the observations that all lanes share, with its record and its files."""

import time
from pathlib import Path

import numpy as np

from .. import core
from ..config import Config
from ..estimators import make_estimator
from ..evaluation.structure import StructureComparison
from ..geometry.medians import median
from ..logs.recording.ground_truth import DepthImages
from ..pipeline.lane import BareLane
from ..pipeline.observer import Observed, Observer
from ..report.records import RunRecord
from ..results.folder import ResultFolder
from ..types import FrameEstimate, Observations, Solution
from .world import World


class Lane(BareLane):
    """One method: its estimator, its `record`, and its result `folder`, if results are written.

    With `depth`, points are compared with these images; with `in_detail`, the record has the figures of all points.

    If the estimator fails in any way, its lane ends: `error` and `record.failure` say why. Other lanes continue.
    """

    def __init__(
        self,
        config: Config,
        observer: Observer,
        depth: DepthImages | None,
        folder: Path | None,
        in_detail: bool = False,
    ) -> None:
        self.config, self._in_detail = config, in_detail
        projection = observer.projection
        super().__init__(observer, make_estimator(config.method, projection, config))
        self.record = RunRecord(config.method, projection.f_px * projection.baseline_m)
        self.error: Exception | None = None
        self.folder = None if folder is None else ResultFolder(folder, observer.rig, config)
        self._depth = depth
        self._structure = StructureComparison(observer.rig.left)
        self._world = World(config.motion)

    def restart(self, observer: Observer) -> None:
        """Continue with the observer of another rig: a new map, in the same world."""
        self._world.restart(self.observer.state.frame_index)
        self.solution = None
        self.observer, self.rig, self._structure.camera = observer, None, observer.rig.left
        self._use(make_estimator(self.config.method, observer.projection, self.config))

    def take(self, observed: Observed) -> FrameEstimate | None:
        """Estimate a frame and write it; None if the lane has failed, now or before."""
        self.solution = None
        if self.error is not None:
            return None
        try:
            estimate = self._world.place(self.estimate(observed), observed.observations)
        except Exception as error:
            self.solution = None
            self.error = error
            kind = "" if isinstance(error, np.linalg.LinAlgError) else f"{type(error).__name__}: "
            self.record.failure = f"stopped at frame {observed.observations.frame_index}: {kind}{error}"
            return None
        if self.inertial is not None:
            self.record.inertial_problem = self.inertial.inertial_problem
        began_s = time.thread_time()
        if self.folder is not None:
            self.folder.write(estimate)
        total_ms = sum(estimate.timings_ms.values()) + 1e3 * (time.thread_time() - began_s)
        of_points = (np.nan, np.nan)
        if self._in_detail and self.solution is not None and len(estimate.points_in_cam):
            of_points = _median_sigma_m(estimate), self._reprojection_px(self.solution, observed.observations)
        self.record.add(estimate, total_ms, of_points)
        self._compare_depth(estimate)
        return estimate

    def _compare_depth(self, estimate: FrameEstimate) -> None:
        """Compare the points with the depth image of the same moment, if there is one."""
        if self._depth is None:
            return
        errors = self._structure.add(estimate, self._depth.at(estimate.stamp_ns))
        self.record.structure = None if self._depth.problem else self._structure
        if errors is not None and len(errors.errors_m):
            rms_m, sigma_m = (float(np.sqrt((x**2).mean())) for x in (errors.errors_m, errors.sigmas_m))
            self.record.depth_rows.append((estimate.frame_index, rms_m, sigma_m))

    def _reprojection_px(self, solution: Solution, observations: Observations) -> float:
        """Return the RMS residual of the current views against the current points, pixels; NaN without points."""
        rows = np.flatnonzero(core.among(observations.track_ids, solution.track_ids))
        points = solution.points_in_cam[core.among(solution.track_ids, observations.track_ids)]
        front = points[:, 2] > 1e-3
        if not front.any():
            return float("nan")
        residuals = observations.z_px[rows[front]] - self.observer.projection.project(points[front])
        return float(np.sqrt(np.nanmean(residuals**2)))


def _median_sigma_m(estimate: FrameEstimate) -> float:
    """Return the median σ of the points along their rays."""
    rays = estimate.points_in_cam / np.maximum(np.linalg.norm(estimate.points_in_cam, axis=1, keepdims=True), 1e-9)
    variance = np.einsum("ni,nij,nj->n", rays, estimate.cov_points, rays)
    return float(np.sqrt(median(np.maximum(variance, 0))))
