"""Measures how long the errors of tracks last and how far tracks slide, for constants of the noise model.

    python -m tools.track_errors logs/room.mcap LOG... --frames 150

For each log: the autocorrelation of the row differences v_left − v_right of a match, in units of its σ, from frame to
frame and the factor per frame at which it falls beyond; what `frontend/learnt/template_errors.py` has learnt of white
and lasting variance and of the decay. Where the log has exact poses and depth images, how far left positions are from
where the point of the first view must be seen, after 1 to 20 frames: of each coordinate, 1.48 times the median.
"""

import argparse
import os
from collections import defaultdict
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from stream_sfm import Engine, open_log
from stream_sfm.camera.lens import project_into_image
from stream_sfm.evaluation.association import matched
from stream_sfm.frontend.learnt.template_errors import TemplateErrors
from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array
from stream_sfm.logs.recording.stereo_log import StereoLog
from stream_sfm.types import Observations, Selection, Trajectory

LAGS = (1, 2, 5, 10, 20)
AGES = (1, 5, 10, 20)
_ROBUST = 1.4826  # of a median: σ of a Gaussian
_EDGE = 0.01  # relative difference of depths around a point that marks a depth edge


class Rows:
    """Products of the row differences of each track, by how many frames lie between."""

    def __init__(self) -> None:
        self._past: list[dict[int, float]] = []
        self._sums = {lag: [0.0, 0] for lag in (0, *LAGS)}

    def add(self, seen: Observations) -> None:
        """Take in the views of a frame."""
        rows = TemplateErrors().after(seen.track_ids, seen.z_px, seen.cov_px).rows[:, 0]
        now = {int(i): float(r) for i, r in zip(seen.track_ids, rows, strict=True) if np.isfinite(r)}
        self._past.append(now)
        for lag, sums in self._sums.items():
            if lag < len(self._past):
                before = self._past[-1 - lag]
                products = [r * before[i] for i, r in now.items() if i in before]
                sums[0] += sum(products)
                sums[1] += len(products)

    def correlations(self) -> list[float]:
        """Over `LAGS`."""
        mean = {lag: total / max(count, 1) for lag, (total, count) in self._sums.items()}
        return [mean[lag] / mean[0] for lag in LAGS]


class Slides:
    """Distances of left positions from those of the true point, by the age of the track."""

    def __init__(self, log: StereoLog, engine: Engine) -> None:
        self._depth, self._truth = log.depth_images(), log.ground_truth()
        self._engine = engine
        self._points: dict[int, tuple[int, Array]] = {}  # frame of the first view, and the point in the world
        self._errors: dict[int, list[Array]] = defaultdict(list)

    def add(self, seen: Observations) -> None:
        """Take in the views of a frame."""
        pose = self._pose(int(seen.stamp_ns))
        if pose is None:
            return
        known = [k for k, i in enumerate(seen.track_ids.tolist()) if i in self._points]
        if known:
            points = np.stack([self._points[int(seen.track_ids[k])][1] for k in known])
            in_rectified = self._rectified(se3.transform(se3.inverse(pose), points))
            errors = seen.z_px[known, :2] - self._engine.observer.projection.project(in_rectified)[:, :2]
            for k, error in zip(known, errors, strict=True):
                age = seen.frame_index - self._points[int(seen.track_ids[k])][0]
                self._errors[age].append(error)
        depth = self._depth.at(int(seen.stamp_ns))
        if depth is not None and seen.n_new:
            self._begin(seen, pose, np.asarray(depth, np.float32))

    def _begin(self, seen: Observations, pose: Array, depth: NDArray[np.float32]) -> None:
        """Remember the true points of new tracks that are not at a depth edge."""
        p = self._engine.observer.projection
        uv = seen.z_px[-seen.n_new :, :2]
        rays = np.column_stack([(uv - (p.cx_left_px, p.cy_px)) / p.f_px, np.ones(len(uv))])
        rays = self._engine.observer.rectifier.rect_from_cam.T @ rays.T
        rays = (rays / rays[2]).T
        at = project_into_image(self._engine.observer.rig.left, rays).astype(np.float32)
        near, far = (
            cv2.remap(extreme(depth, np.ones((5, 5))), at[:, None], None, cv2.INTER_NEAREST)
            for extreme in (cv2.erode, cv2.dilate)
        )
        depths = cv2.remap(depth, at[:, None], None, cv2.INTER_LINEAR)[:, 0]
        smooth = (far - near)[:, 0] < _EDGE * depths
        world = se3.transform(pose, rays * depths[:, None])
        for i, good, point in zip(seen.track_ids[-seen.n_new :].tolist(), smooth, world, strict=True):
            if good:
                self._points[i] = seen.frame_index, point

    def _pose(self, stamp_ns: int) -> Array | None:
        if self._truth is None:
            return None
        rows, found = matched(Trajectory(np.array([stamp_ns]), np.eye(4)[None]), self._truth)
        return found.world_from_cam[0] if len(rows) else None

    def _rectified(self, in_cam: Array) -> Array:
        return in_cam @ self._engine.observer.rectifier.rect_from_cam.T

    def spread_px(self) -> list[float | None]:
        """Over `AGES`; None if no track was seen."""
        found = [np.abs(np.array(self._errors[age])) for age in AGES]
        return [_ROBUST * float(np.nanmedian(errors)) if errors.size else None for errors in found]


def main() -> None:
    """Print a table with a row per log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--frames", type=int, default=150)
    args = parser.parse_args()
    lags, ages = (f"after {lag}" for lag in LAGS), (f"px after {age}" for age in AGES)
    table = Table("log", *lags, "per frame", "white", "lasting", "decay", *ages)
    for path in args.logs:
        log = open_log(path)
        engine = Engine(log.stereo_rig)
        rows, slides = Rows(), Slides(log, engine)
        for frame in log.frames(Selection(max_frames=args.frames)):
            engine.step(frame)
            if engine.observations is not None:
                rows.add(engine.observations)
                slides.add(engine.observations)
        found = np.array(rows.correlations())
        decay = (found[-1] / found[0]) ** (1 / (LAGS[-1] - LAGS[0])) if (found[[0, -1]] > 0).all() else None
        learnt = engine.observer.state.errors
        numbers = [*found, decay, *learnt.parts, learnt.decay, *slides.spread_px()]
        table.add_row(path.stem, *("–" if x is None else f"{x:.2f}" for x in numbers))
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
