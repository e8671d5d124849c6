"""One trial of several estimators on one simulated sequence: squared and normalised errors, and the bound, eq. (62)."""

from collections.abc import Callable
from collections.abc import Sequence as Listed
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..estimators import make_estimator
from ..estimators.baselines.full_batch import Bound, cramer_rao_bound
from ..geometry import Array, se3
from ..geometry.linear import mahalanobis2
from ..types import Estimator, Observations, Solution, Status
from .scenes import Scene, Sequence

QUANTITIES = ("rotation", "position", "global_structure", "local_structure")
Measured = dict[str, dict[str, Array]]  # label -> quantity -> values (k,) of one trial, (trials, k) of all
NORMALISED = ("nees_pose", "nees_point", "nees_point_in_world")  # closed form: 6, 3 and 3 are expected


@dataclass(frozen=True, slots=True)
class Method:
    """An estimator of a study: `name` in METHODS, a window of `frames`, and the `key` of its results."""

    name: str
    frames: int = 8
    key: str = ""  # empty: the name

    def make(self, sequence: Sequence) -> Estimator:
        window = msgspec.structs.replace(Config().window, frames=self.frames)
        config = msgspec.structs.replace(Config(), window=window)
        return make_estimator(self.name, sequence.projection, config)


def measure(
    seed: np.random.SeedSequence, scene: Scene, methods: Listed[Method], frames: Listed[int], bound: bool = True
) -> Measured:
    """Run one trial, and return label -> quantity -> values (len(frames),), NaN where the frame was lost.

    Quantities: rotation (rad²), position (m²), structure (m², mean over the points in view), `bound_<quantity>` of the
    very same points, and NEES. With `bound`, an entry "bound" holds the variances of the bound itself.
    """
    sequence = scene.sequence(seed)
    bounds = {n: bound_of(sequence, n) for n in frames} if bound else {}
    names = (*QUANTITIES, *NORMALISED, *(f"bound_{q}" for q in QUANTITIES if bound))

    def figures(frame: int, solution: Solution) -> dict[str, float]:
        found = errors(sequence, frame, solution)
        if bound:
            rows = np.searchsorted(bounds[frame].track_ids, solution.track_ids)
            found |= {f"bound_{q}": v for q, v in traces(bounds[frame], rows).items()}
        return found

    observations = sequence.observations[: max(frames) + 1]
    result = {m.key or m.name: followed(m.make(sequence), observations, frames, names, figures) for m in methods}
    return result | ({"bound": bound_variances(list(bounds.values()))} if bound else {})


def followed(
    estimator: Estimator,
    observations: Listed[Observations],
    frames: Listed[int],
    names: Listed[str],
    figures: Callable[[int, Solution], dict[str, float]],
) -> dict[str, Array]:
    """Run an estimator, and return the `figures` with these `names` at `frames`, NaN where a frame was lost."""
    result = {name: np.full(len(frames), np.nan) for name in names}
    for o in observations:
        solution = estimator.step(o)
        if o.frame_index in frames and solution.status is not Status.LOST:
            found = figures(o.frame_index, solution)
            for name in names:
                result[name][frames.index(o.frame_index)] = found[name]
    return result


def bound_of(sequence: Sequence, frame: int | None = None, newest: int | None = None) -> Bound:
    """Return the Cramér–Rao bound at a frame (None: the last one), from all views or those of the `newest` frames."""
    since = slice(None if newest is None else -newest, None)
    views, poses = sequence.observations[since], sequence.world_from_cam[since]
    return cramer_rao_bound(sequence.projection, views, poses, sequence.points_in_world, frame)


def bound_variances(bounds: Listed[Bound]) -> dict[str, Array]:
    """Return quantity -> variances (n,) of n bounds."""
    rows = [traces(bound, slice(None)) for bound in bounds]
    return {q: np.array([row[q] for row in rows]) for q in QUANTITIES}


def traces(bound: Bound, rows: slice | NDArray[np.intp]) -> dict[str, float]:
    """Return the variances of a bound: of the pose, and the mean of the points in view in `rows`."""
    pose = bound.cov_poses[-1]
    return {
        "rotation": float(np.trace(pose[3:, 3:])),
        "position": float(np.trace(pose[:3, :3])),
        "global_structure": float(bound.cov_points_in_world[rows].trace(axis1=1, axis2=2).mean()),
        "local_structure": float(bound.cov_points_in_cam[rows].trace(axis1=1, axis2=2).mean()),
    }


def errors(sequence: Sequence, frame: int, solution: Solution) -> dict[str, float]:
    """Return squared and normalised errors of one frame against the truth."""
    truth = sequence.world_from_cam[frame]
    points = sequence.points_in_world[solution.track_ids]
    xi = se3.log(se3.inverse(solution.world_from_cam) @ truth)
    position = solution.world_from_cam[:3, 3] - truth[:3, 3]
    in_world = solution.points_in_world - points
    in_cam = solution.points_in_cam - se3.transform(se3.inverse(truth), points)
    exact = not solution.cov_pose.any()  # as the first frame is, by definition
    return {
        "rotation": float(xi[3:] @ xi[3:]),
        "position": float(position @ position),
        "global_structure": float((in_world**2).sum(axis=1).mean()),
        "local_structure": float((in_cam**2).sum(axis=1).mean()),
        "nees_pose": np.nan if exact else float(mahalanobis2(xi[None], solution.cov_pose[None]).mean()),
        "nees_point": float(mahalanobis2(in_cam, solution.cov_points).mean()),
        "nees_point_in_world": float(mahalanobis2(in_world, solution.cov_points_in_world).mean()),
    }
