"""Matches ground truth to the stamps of an estimate. NaN poses mark moments whose truth must not be used."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError, LogError
from ..geometry import Array, se3
from ..types import Trajectory
from .settings import SETTINGS


def check_rigid(truth: Trajectory) -> None:
    """Raise a LogError that names the first pose which is not a rigid motion; NaN poses are skipped."""
    poses = truth.world_from_cam
    known = np.atleast_1d(np.isfinite(poses).all(axis=(1, 2)))
    rotations = np.where(known[:, None, None], poses, np.eye(4))[:, :3, :3]
    wrong = np.flatnonzero(~se3.is_rotation(rotations, se3.ROUNDED))
    if len(wrong):
        row = int(wrong[0])
        mirrored = se3.is_rotation(-rotations[row], se3.ROUNDED)
        what = "all zeros" if not rotations[row].any() else "mirrored" if mirrored else "not a rotation"
        raise LogError(
            f"ground truth: the rotation of pose {row} (stamp {truth.stamps_ns[row]} ns) is {what}; give poses in "
            "right-handed axes, their 3×3 part a rotation with determinant +1"
        )


def first_of_each(stamps_ns: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return the rows of the first of equal stamps (n,), by stamp; `np.unique` imports masked arrays for it: 7 ms."""
    order = np.argsort(stamps_ns, kind="stable")
    return order[np.insert(np.diff(stamps_ns[order]) != 0, 0, True)] if len(order) else order


def matched(estimate: Trajectory, truth: Trajectory) -> tuple[NDArray[np.int64], Trajectory]:
    """Find the rows of the estimate that have a ground truth, and the truth at exactly their stamps.

    A truth with the same stamp is used as it is. Otherwise its two neighbours are interpolated on SE(3) (constant
    twist) if they are at most 150 ms apart; failing that, a truth within 1 ms is used. Other rows have no truth, and
    rows where it is NaN have none either. Truths need not be sorted; of equal stamps the first is used.
    """
    first = first_of_each(truth.stamps_ns)
    stamps, poses = truth.stamps_ns[first], truth.world_from_cam[first]
    wanted = estimate.stamps_ns
    if len(stamps) == 0 or len(wanted) == 0:
        return np.empty(0, np.int64), Trajectory(np.empty(0, np.int64), np.empty((0, 4, 4)))
    after = np.clip(np.searchsorted(stamps, wanted), 0, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(abs(stamps[after] - wanted) <= abs(wanted - stamps[before]), after, before)
    offset = abs(stamps[nearest] - wanted)
    gap = stamps[after] - stamps[before]
    inside = (stamps[before] <= wanted) & (wanted <= stamps[after]) & (gap > 0) & (gap <= SETTINGS.max_gap_ns)
    between = inside & (offset > 0)
    found = between | (offset <= SETTINGS.same_stamp_ns)

    result = poses[nearest].copy()
    if between.any():
        fraction = (wanted - stamps[before])[between] / gap[between]
        world_from_a, world_from_b = poses[before[between]], poses[after[between]]
        moved = se3.exp(fraction[:, None] * se3.log(se3.inverse(world_from_a) @ world_from_b))
        result[between] = world_from_a @ moved
    found &= np.isfinite(result).all(axis=(1, 2))
    rows = np.flatnonzero(found).astype(np.int64)
    return rows, Trajectory(wanted[rows], result[rows])


def truth_of_frames(stamps_ns: NDArray[np.int64], truth: Trajectory) -> Array:
    """Return the truth (n, 4, 4) of each frame, NaN where there is none."""
    rows, true = matched(Trajectory(stamps_ns, np.empty((len(stamps_ns), 4, 4))), truth)
    poses = np.full((len(stamps_ns), 4, 4), np.nan)
    poses[rows] = true.world_from_cam
    return poses


def checked_ranges(ranges: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the ranges [first, end) of frames. Raises ConfigError if one of them is not a range."""
    for given in ranges:
        if len(given) != 2 or not all(isinstance(n, int) for n in given) or not 0 <= given[0] < given[1]:
            raise ConfigError(f"{given!r} is not a range of frames: give (first, end) with 0 <= first < end")
    return [(first, end) for first, end in ranges]


def without_frames(truth: Trajectory, stamps_ns: NDArray[np.int64], ranges: Sequence[tuple[int, int]]) -> Trajectory:
    """Return the truth with NaN in the frames of `ranges` [first, end), which count in `stamps_ns` from 0."""
    ignored = np.zeros(len(stamps_ns), bool)
    for first, end in ranges:
        ignored[first:end] = True
    if not ignored.any():
        return truth
    wanted = stamps_ns[ignored]
    keep = ~np.isin(truth.stamps_ns, wanted)
    stamps = np.concatenate([truth.stamps_ns[keep], wanted])
    poses = np.concatenate([truth.world_from_cam[keep], np.full((len(wanted), 4, 4), np.nan)])
    order = np.argsort(stamps, kind="stable")
    return Trajectory(stamps[order], poses[order])
