"""KITTI's t_rel and r_rel, eqs. (55) and (56): mean errors of relative motions over segments of fixed lengths.

As defined by Geiger, Lenz and Urtasun (CVPR 2012) and their devkit (`evaluate_odometry.cpp`): a segment begins at a
frame and ends at the first frame *beyond* the length along the true path; its error is inverse(estimated motion)·true
motion; the means are taken over all segments of all lengths. The devkit begins a segment at every tenth frame and
uses lengths of 100, 200 … 800 m, and so does this module where the path is at least 200 m long. A shorter path is
measured over 10, 20 … 100 m, and one below 20 m over 10, 20 … 90 % of its length, with a segment from every frame.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import se3
from ..geometry.se3 import Array
from .drift import distances_m

_DEVKIT_STEP = 10  # frames between the starts of two segments, as in the devkit


@dataclass(frozen=True, slots=True)
class SegmentErrors:
    """Mean errors over all segments, NaN where there are none.

    `lengths_m`: the lengths for which there is at least one segment; `count`: the number of segments.
    """

    t_rel_percent: float
    r_rel_deg_per_100m: float
    lengths_m: tuple[float, ...]
    count: int


def lengths_for_path(path_m: float) -> tuple[tuple[float, ...], int]:
    """Return segment lengths in metres, and the number of frames between starts, for a path of `path_m` metres."""
    if path_m >= 200:
        return tuple(100.0 * k for k in range(1, 9)), _DEVKIT_STEP
    if path_m >= 20:
        return tuple(10.0 * k for k in range(1, 11)), 1
    return tuple(path_m * k / 10 for k in range(1, 10)), 1


def segment_errors(
    estimate: Array, truth: Array, lengths_m: tuple[float, ...] | None = None, step: int | None = None
) -> SegmentErrors:
    """Compute the segment errors of poses world_from_cam (n, 4, 4); lengths and step follow from the path."""
    along = distances_m(truth)
    path_m = float(along[-1]) if len(along) else 0.0
    default_lengths, default_step = lengths_for_path(path_m)
    starts = np.arange(0, len(along), step or default_step)
    translation, rotation, used = [], [], []
    for length in lengths_m or default_lengths:
        if length <= 0:
            continue
        ends = np.searchsorted(along, along[starts] + length, side="right")
        inside = ends < len(along)
        if not inside.any():
            continue
        a, b = starts[inside], ends[inside]
        error = se3.inverse(_motion(estimate, a, b)) @ _motion(truth, a, b)
        translation.append(np.linalg.norm(error[:, :3, 3], axis=1) / length)
        rotation.append(np.linalg.norm(se3.log_so3(error[:, :3, :3]), axis=1) / length)
        used.append(length)
    if not used:
        return SegmentErrors(float("nan"), float("nan"), (), 0)
    t, r = np.concatenate(translation), np.concatenate(rotation)
    return SegmentErrors(100 * float(t.mean()), 100 * float(np.degrees(r.mean())), tuple(used), len(t))


def _motion(world_from_cam: Array, a: NDArray[np.integer], b: NDArray[np.integer]) -> Array:
    return se3.inverse(world_from_cam[a]) @ world_from_cam[b]
