"""One trial of several estimators on one simulated sequence: squared and normalised errors, and the bound, eq. (62)."""

from collections.abc import Sequence as Listed
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..estimators import make_estimator
from ..estimators.baselines.full_batch import Bound, cramer_rao_bound
from ..geometry import se3
from ..geometry.linear import mahalanobis2
from ..geometry.se3 import Array
from ..types import Solution, Status
from .scenes import Scene, Sequence

QUANTITIES = ("rotation", "position", "global_structure", "local_structure")
NORMALISED = ("nees_pose", "nees_point", "nees_point_in_world")  # closed form: 6, 3 and 3 are expected


@dataclass(frozen=True, slots=True)
class Method:
    """An estimator of a study: `name` in METHODS, a window of `frames`, and the `key` of its results."""

    name: str
    frames: int = 8
    key: str = ""  # empty: the name

    @property
    def label(self) -> str:
        """The key of its results."""
        return self.key or self.name


def measure(
    seed: np.random.SeedSequence, scene: Scene, methods: Listed[Method], frames: Listed[int], bound: bool = True
) -> dict[str, dict[str, Array]]:
    """Run one trial, and return label -> quantity -> values (len(frames),), NaN where the frame was lost.

    Quantities: rotation (rad²), position (m²), structure (m², mean over the points in view), `bound_<quantity>` of the
    very same points, and NEES. With `bound`, an entry "bound" holds the variances of the bound itself.
    """
    sequence = scene.sequence(seed)
    bounds = {n: _bound(sequence, n) for n in frames} if bound else {}
    result = {m.label: _measure_one(sequence, m, frames, bounds) for m in methods}
    if bound:
        rows = [traces(bounds[n], slice(None)) for n in frames]
        result["bound"] = {q: np.array([r[q] for r in rows]) for q in QUANTITIES}
    return result


def _bound(sequence: Sequence, frame: int) -> Bound:
    s = sequence
    return cramer_rao_bound(s.projection, s.observations, s.world_from_cam, s.points_in_world, frame)


def traces(bound: Bound, rows: slice | NDArray[np.intp]) -> dict[str, float]:
    """Return the variances of a bound: of the pose, and the mean of the points in view in `rows`."""
    pose = bound.cov_poses[-1]
    return {
        "rotation": float(np.trace(pose[3:, 3:])),
        "position": float(np.trace(pose[:3, :3])),
        "global_structure": float(bound.cov_points_in_world[rows].trace(axis1=1, axis2=2).mean()),
        "local_structure": float(bound.cov_points_in_cam[rows].trace(axis1=1, axis2=2).mean()),
    }


def _measure_one(
    sequence: Sequence, method: Method, frames: Listed[int], bounds: dict[int, Bound]
) -> dict[str, Array]:
    names = (*QUANTITIES, *NORMALISED, *(f"bound_{q}" for q in QUANTITIES if bounds))
    result = {name: np.full(len(frames), np.nan) for name in names}
    window = msgspec.structs.replace(Config().window, frames=method.frames)
    estimator = make_estimator(method.name, sequence.projection, msgspec.structs.replace(Config(), window=window))
    wanted = {n: k for k, n in enumerate(frames)}
    for n, observations in enumerate(sequence.observations[: max(frames) + 1]):
        solution = estimator.step(observations)
        if n not in wanted or solution.status is Status.LOST:
            continue
        values = errors(sequence, n, solution)
        if bounds:
            rows = np.searchsorted(bounds[n].track_ids, solution.track_ids)
            values |= {f"bound_{q}": v for q, v in traces(bounds[n], rows).items()}
        for name, value in values.items():
            result[name][wanted[n]] = value
    return result


def errors(sequence: Sequence, frame: int, solution: Solution) -> dict[str, float]:
    """Return squared and normalised errors of one frame against the truth."""
    truth = sequence.world_from_cam[frame]
    points = sequence.points_in_world[solution.track_ids]
    xi = se3.log(se3.inverse(solution.world_from_cam) @ truth)
    position = solution.world_from_cam[:3, 3] - truth[:3, 3]
    in_world = solution.points_in_world - points
    in_cam = solution.points_in_cam - se3.transform(se3.inverse(truth), points)
    return {
        "rotation": float(xi[3:] @ xi[3:]),
        "position": float(position @ position),
        "global_structure": float((in_world**2).sum(axis=1).mean()),
        "local_structure": float((in_cam**2).sum(axis=1).mean()),
        "nees_pose": float(mahalanobis2(xi[None], solution.cov_pose[None]).mean())
        if solution.cov_pose.any()
        else np.nan,
        "nees_point": float(mahalanobis2(in_cam, solution.cov_points).mean()),
        "nees_point_in_world": float(mahalanobis2(in_world, solution.cov_points_in_world).mean()),
    }


def stacked(trials: list[dict[str, dict[str, Array]]]) -> dict[str, dict[str, Array]]:
    """Return label -> quantity -> values (trials, frames) of a list of trials."""
    return {
        label: {name: np.stack([t[label][name] for t in trials]) for name in trials[0][label]}
        for label in trials[0]
    }
