"""Compares the errors of methods over spans of frames with those of the window, over many seeds of several motions.

    python -m tools.spans                          # 20 seeds of four simulated motions, some minutes
    python -m tools.spans --seeds 5 --motions walking turning
    python -m tools.spans LOG... --set rig.exact=true   # rendered logs: NAME1.mcap, NAME2.mcap … are seeds of NAME

One path is one sample; only many say which method is ahead, and at which spans. All methods get the same observations
and covariances; rows "with lasting errors" weight them as the window's filter does. Simulated views have the errors
that views of rendered logs have against exact truth: white noise that differs between tracks, a slide of the patch that
both sides share and that grows as a random walk from the first view, a constant of the right side alone, and gross
mismatches; the rig is exact. Each figure is the RMS error of a method over that of the window's poses, as a geometric
mean over seeds and motions, with the 95 % interval of the mean over seeds. "Newest motions" are those of the window
since the previous frame, added up: odometry. "Bound" is what no causal estimator goes below (`tools/bound.py`). Below
are the NEES of poses, 6 expected, and the factor by which σ of the window's relative motions would have to grow.
"""

import argparse
import os
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))
from bound import TrackViews, causal_errors

from stream_sfm import Engine, open_log, read_config
from stream_sfm.config import Config
from stream_sfm.errors import ConfigError, require_study
from stream_sfm.estimators import make_estimator
from stream_sfm.frontend.learnt.template_errors import TemplateErrors, turn_of_slides
from stream_sfm.frontend.rules import ErrorRules
from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.methods import REFERENCE
from stream_sfm.types import LastingErrors, Observations, RelativeMotions

SPANS = (1, 2, 5, 10, 20, 50)
OWN_SPANS = (1, 2, 5, 8)  # within the window
METHODS = ("cross-frame", "iterated-ekf", "iterated-ekf-lasting", "ekf", "ekf-lasting", "frame-to-frame")
POSES, ADDED, BOUND = "poses", "newest motions", "bound"
FRAMES, FRAME_NS, TRACKS = 80, 50_000_000, 150
WHITE_PX, CLAIMED_PX, CONSTANT_PX, CLAIMED_SLIDE, HALF_PATCH_PX = 0.04, 0.05, 0.04, 0.1, 10.0
# Measured on exact renders, from left positions against the ray of the first view, up to 20 frames after it: slides per
# change of the patch (`rules.errors.slide` claims a tenth), and in px per frame whatever moves. A drive through a
# corridor, one sideways, a room with turns of 152°, and hand-held at up to 94° per second.
SLIDES = {"walking": (0.09, 0.0), "lateral": (0.13, 0.0), "turning": (0.18, 0.0), "hand-held": (0.1, 0.02)}
SPREAD = 0.25  # variance of the variances of tracks, relative; 0.2 to 0.35 on most logs, eq. (69c)
MISMATCHED, MISMATCH_PX = 0.002, 3.0  # share of the views, and their largest error; 0.0004 to 0.003 are beyond 1 px
ENDS = 0.03  # share of the tracks that end in a frame, for whatever reason
PROJECTION = StereoProjection(
    f_px=400.0, cx_left_px=319.5, cx_right_px=319.5, cy_px=239.5, baseline_m=0.12, width=640, height=480
)


def _waves(amplitude: Array, slowest_s: float, rng: np.random.Generator, t: Array) -> Array:
    """A smooth random path (n, 6) of about so large amplitudes (6,)."""
    frequency, phase = rng.uniform(0.3, 1.0, (3, 6)) / slowest_s, rng.uniform(0, 2 * np.pi, (3, 6))
    return np.asarray(amplitude * np.sin(2 * np.pi * frequency * t[:, None, None] + phase).sum(axis=1))


def _path(speed: Array, amplitude: Array, slowest_s: float, rng: np.random.Generator) -> Array:
    """Poses (n, 4, 4) at a steady speed (6,) per second that waves by `amplitude` (6,)."""
    t = np.arange(FRAMES) * FRAME_NS / 1e9
    return se3.exp(t[:, None] * speed) @ se3.exp(_waves(amplitude, slowest_s, rng, t))


MOTIONS: dict[str, Callable[[np.random.Generator], Array]] = {
    "walking": partial(_path, np.array([0, 0, 1.2, 0, 0, 0]), np.array([0.04, 0.02, 0.03, 0.01, 0.06, 0.01]), 0.6),
    "hand-held": partial(_path, np.zeros(6), np.array([0.15, 0.1, 0.15, 0.08, 0.15, 0.05]), 1.5),
    "lateral": partial(_path, np.array([0.4, 0, 0, 0, 0, 0]), np.array([0.02, 0.02, 0.02, 0.01, 0.01, 0.01]), 1.0),
    "turning": partial(_path, np.array([0.1, 0, 0.2, 0, 0.5, 0]), np.array([0.03, 0.03, 0.03, 0.03, 0.15, 0.02]), 1.0),
}


@dataclass(slots=True)
class Tracks:
    """Points that are followed: ids (n,), places in the world (n, 3), slides (n, 2) and right constants (n, 2), px.

    `white_px` (n,): σ of the white noise of each; `views`: of all tracks so far, for the bound.
    """

    ids: np.ndarray
    in_world: Array
    slide_px: Array
    right_px: Array
    white_px: Array
    views: list[TrackViews]

    def rows(self, keep: np.ndarray) -> "Tracks":
        columns = (self.ids, self.in_world, self.slide_px, self.right_px, self.white_px)
        return Tracks(*(column[keep] for column in columns), self.views)

    def with_new(self, first_id: int, world_from_cam: Array, rng: np.random.Generator) -> "Tracks":
        """Points begin at random places of the image, as far off as those of a room are."""
        n = TRACKS - len(self.ids)
        z = rng.uniform(1 / 8, 1 / 1.5, n) ** -1.0
        place = rng.uniform((40, 0), (PROJECTION.width, PROJECTION.height), (n, 2))
        ray = (place - (PROJECTION.cx_left_px, PROJECTION.cy_px)) / PROJECTION.f_px
        in_world = se3.transform(world_from_cam, z[:, None] * np.column_stack([ray, np.ones(n)]))
        white_px = WHITE_PX * np.sqrt((1 + 1 / SPREAD) / rng.gamma(2 + 1 / SPREAD, size=n))  # λ of (69c)
        self.views.extend(TrackViews(x, float(std)) for x, std in zip(in_world, white_px, strict=True))
        return Tracks(
            np.concatenate([self.ids, first_id + np.arange(n)]),
            np.concatenate([self.in_world, in_world]),
            np.concatenate([self.slide_px, np.zeros((n, 2))]),
            np.concatenate([self.right_px, rng.normal(0, CONSTANT_PX, (n, 2))]),
            np.concatenate([self.white_px, white_px]),
            self.views,
        )


class Source(NamedTuple):
    """The pair, the observations of every frame, the true poses (n, 4, 4), and the errors of simulated tracks."""

    projection: StereoProjection
    observations: list[Observations]
    true: Array
    views: Sequence[TrackViews] = ()


def simulated(motion: str, seed: int) -> Source:
    """Return a simulated run."""
    rng = np.random.default_rng([sorted(MOTIONS).index(motion), seed])
    poses, (share, steady_px) = MOTIONS[motion](rng), SLIDES[motion]
    tracks = Tracks(np.empty(0, np.int64), np.empty((0, 3)), *np.empty((2, 0, 2)), np.empty(0), [])
    errors, observations, first_id, p = TemplateErrors(), [], 0, PROJECTION
    for n, pose in enumerate(poses):
        in_cam = se3.transform(se3.inverse(pose), tracks.in_world)
        z = p.project(np.maximum(in_cam, [-np.inf, -np.inf, 0.1]))
        inside = (in_cam[:, 2] > 0.3) & (z > 0).all(1) & (z < [p.width, p.height] * 2).all(1)
        tracks = tracks.rows(inside & (rng.random(len(z)) > ENDS))
        old = len(tracks.ids)
        changed_px = np.zeros(old)
        if n:
            moved = np.linalg.norm(pose[:3, 3] - poses[n - 1][:3, 3])
            changed_px = HALF_PATCH_PX * moved / se3.transform(se3.inverse(pose), tracks.in_world)[:, 2]
        slid_px = np.hypot(share * changed_px, steady_px)
        tracks.slide_px = tracks.slide_px + slid_px[:, None] * rng.normal(size=(old, 2))
        tracks = tracks.with_new(first_id, pose, rng)
        drift_px = np.concatenate([CLAIMED_SLIDE * changed_px, np.zeros(len(tracks.ids) - old)])
        first_id = int(tracks.ids[-1]) + 1
        error_px = tracks.white_px[:, None] * rng.normal(size=(TRACKS, 4))
        error_px += np.hstack([tracks.slide_px, tracks.slide_px + tracks.right_px])
        for k, (track, slid) in enumerate(zip(tracks.ids, [*slid_px, *np.zeros(TRACKS - old)], strict=True)):
            of = tracks.views[track]
            of.frames.append(n), of.errors_px.append(error_px[k]), of.var_slides_px2.append(float(slid) ** 2)
        wrong = (rng.random(TRACKS) < MISMATCHED)[:, None] * rng.uniform(-MISMATCH_PX, MISMATCH_PX, (TRACKS, 4))
        z = p.project(se3.transform(se3.inverse(pose), tracks.in_world)) + error_px + wrong
        cov = np.tile(CLAIMED_PX**2 * np.eye(4), (TRACKS, 1, 1))
        errors = errors.after(tracks.ids, z, cov)
        std_turn_rad = turn_of_slides(drift_px[:old], p.f_px, Config().rules.of(ErrorRules).alike) if n else 0.0
        lasting = LastingErrors(drift_px, errors.inflation, std_turn_rad)
        observations.append(Observations(n, n * FRAME_NS, tracks.ids, z, cov, n_new=TRACKS - old, lasting=lasting))
    return Source(p, observations, poses, tracks.views)


def seen(path: Path, config: Config) -> Source:
    """Return the same of a log: what the front-end finds in it, and its ground truth in rectified axes."""
    log = open_log(path)
    engine, truth = Engine(log.stereo_rig, config), log.ground_truth()
    if truth is None:
        raise SystemExit(f"{path} has no ground truth")
    observations = []
    for frame in log.frames():
        engine.step(frame)
        observations.append(engine.observations)
    found = [o for o in observations if o is not None]
    at = np.array([np.abs(truth.stamps_ns - o.stamp_ns).argmin() for o in found])
    rect_from_cam = np.eye(4)
    rect_from_cam[:3, :3] = engine.observer.rectifier.rect_from_cam[:3, :3]
    return Source(engine.observer.projection, found, truth.world_from_cam[at] @ se3.inverse(rect_from_cam))


Errors = dict[tuple[str, int], tuple[float, float]]  # (row, span): RMS of positions, m, and of rotations, rad


def _over_spans(name: str, estimated: Array, true: Array) -> Errors:
    result = {}
    for span in SPANS:
        if span < len(true):
            moved = (se3.inverse(x[:-span]) @ x[span:] for x in (true, estimated))
            xi = se3.log(se3.inverse(next(moved)) @ next(moved))
            result[name, span] = (
                float(np.sqrt((xi[:, :3] ** 2).sum(1).mean())),
                float(np.sqrt((xi[:, 3:] ** 2).sum(1).mean())),
            )
    return result


class Measured(NamedTuple):
    """Errors of all methods, the mean NEES of their poses, and by span ξᵀΣ⁻¹ξ/6 of relative motions of the window."""

    errors: Errors
    nees: dict[str, float]
    relative: dict[int, list[float]]


def measured(source: Source, config: Config, methods: Sequence[str] = METHODS) -> Measured:
    """Run the methods on the observations, and compare with the truth."""
    projection, observations, true, views = source
    result = Measured({}, {}, defaultdict(list))
    for method in (m for m in methods if m != BOUND):
        estimator, poses, added, nees = make_estimator(method, projection, config), [], [np.eye(4)], []
        for n, o in enumerate(observations):
            solution = estimator.step(o)
            poses.append(solution.world_from_cam)
            if n == 0:
                continue
            xi = se3.log(se3.inverse(poses[0] @ se3.inverse(true[0]) @ true[n]) @ poses[n])
            nees.append(float(xi @ np.linalg.solve(solution.cov_pose, xi)))
            relative, newest = solution.relative, se3.inverse(poses[-2]) @ poses[-1]
            if method == REFERENCE and relative is not None:
                newest = relative.frame_from_newest[-1]
                _add_relative(result.relative, relative, o.frame_index, true[: n + 1])
            added.append(se3.orthonormalise(added[-1] @ newest))
        if method == REFERENCE:
            result.errors.update(_over_spans(POSES, np.array(poses), true))
            result.errors.update(_over_spans(ADDED, np.array(added), true))
        else:
            result.errors.update(_over_spans(method, np.array(poses), true))
        result.nees[method] = float(np.mean(nees))
    if views and BOUND in methods:
        off = se3.exp(causal_errors(projection, true, views, CONSTANT_PX))
        result.errors.update(_over_spans(BOUND, true @ off, true))
    return result


def _add_relative(found: dict[int, list[float]], relative: RelativeMotions, frame_index: int, true: Array) -> None:
    """Add the squared errors of the motions from the newest frame to earlier ones, in their σ, by span."""
    for index, pose, cov in zip(relative.frame_indices, relative.frame_from_newest, relative.cov, strict=True):
        span = frame_index - int(index)
        xi = se3.log(se3.inverse(se3.inverse(true[-1 - span]) @ true[-1]) @ pose)
        found[span].append(float(xi @ np.linalg.solve(cov, xi)) / 6)


def _trial(job: tuple[str, int, Path | None], config: Config) -> tuple[str, Measured]:
    motion, seed, path = job
    source = simulated(motion, seed) if path is None else seen(path, config)
    return motion, measured(source, config, (*METHODS, BOUND))


def mean_ratio(logs: list[Array]) -> str:
    """The geometric mean of ratios, whose logarithms are given by motion, with its interval: seeds are independent."""
    from scipy.special import stdtrit  # of the extra `study`; --help works without it

    means = [np.mean(x) for x in logs]
    n, middle = sum(map(len, logs)), float(np.mean(means))
    if n <= len(logs):
        return f"{np.exp(middle):.2f}"
    variance = sum(((x - m) ** 2).sum() for x, m in zip(logs, means, strict=True)) / (n - len(logs))
    half = float(stdtrit(n - len(logs), 0.975)) * np.sqrt(variance * sum(1 / len(x) for x in logs)) / len(logs)
    return f"{np.exp(middle):.2f} [{np.exp(middle - half):.2f}, {np.exp(middle + half):.2f}]"


def tables(results: list[tuple[str, Measured]]) -> Iterator[Table]:
    """One of positions and one of rotations, over the motions together and by each, one of NEES and one of σ."""
    motions = sorted({motion for motion, _ in results})
    groups = [motions, *([m] for m in motions if len(motions) > 1)]
    for k, (quantity, unit) in enumerate((("position", "mm"), ("rotation", "mrad"))):
        table = Table("motion", "over the window's poses", *map(str, SPANS), title=f"RMS {quantity} errors by span")
        for group in groups:
            of_group = [(m, found.errors) for m, found in results if m in group]
            cells = []
            for span in SPANS:
                known = [e[POSES, span][k] for _, e in of_group if (POSES, span) in e]
                cells.append(f"{1e3 * np.sqrt(np.mean(np.square(known))):.3g} {unit}" if known else "")
            table.add_row(_label(group), "the window's poses", *cells, style="dim")
            for name in (ADDED, *METHODS[1:], BOUND):
                table.add_row("", name, *(_ratio_of(name, span, k, group, of_group) for span in SPANS))
        yield table
    table = Table("motion", *METHODS, title="NEES of poses, 6 expected")
    for group in groups:
        nees = [found.nees for m, found in results if m in group]
        table.add_row(_label(group), *(f"{np.mean([x[name] for x in nees]):.1f}" for name in METHODS))
    yield table
    table = Table("motion", *map(str, OWN_SPANS), title="factor that σ of relative motions needs")
    for motion in motions:
        values = {s: [x for m, found in results if m == motion for x in found.relative[s]] for s in OWN_SPANS}
        table.add_row(motion, *(f"{np.sqrt(np.mean(v)):.2f}" if v else "" for v in values.values()))
    yield table


def _label(group: list[str]) -> str:
    return "all" if len(group) > 1 else group[0]


def _ratio_of(name: str, span: int, kind: int, group: list[str], of_group: list[tuple[str, Errors]]) -> str:
    """Return the mean ratio of a method over a span, with its interval; empty if no log has it."""
    logs = [
        np.array(
            [np.log(e[name, span][kind] / e[POSES, span][kind]) for m, e in of_group if m == one and (name, span) in e]
        )
        for one in group
    ]
    return mean_ratio([x for x in logs if len(x)]) if any(map(len, logs)) else ""


def main() -> None:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, help="logs with exact ground truth, in place of simulations")
    parser.add_argument("--motions", nargs="+", choices=sorted(MOTIONS), default=sorted(MOTIONS))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args()
    try:
        require_study("a comparison of methods")
    except ConfigError as error:
        parser.error(str(error))
    jobs: list[tuple[str, int, Path | None]] = [(re.sub(r"\d+$", "", p.stem), 0, p) for p in arguments.logs]
    jobs = jobs or [(motion, seed, None) for motion in arguments.motions for seed in range(arguments.seeds)]
    run = partial(_trial, config=read_config(None, arguments.overrides))
    with ProcessPoolExecutor(arguments.workers) as pool:
        results = list(pool.map(run, jobs))
    console = Console(width=170)
    for table in tables(results):
        console.print(table)


if __name__ == "__main__":
    main()
