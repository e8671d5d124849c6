"""Errors that all methods share against the truth: a constant turn of the camera's axes, and a factor of all lengths.

A truth that belongs to other axes than the camera's, or a baseline that is off, makes every method err alike; beside
that nothing can be seen of what distinguishes them. So both are fitted to all methods together, and taken out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array
from .relative import known_frames

_CERTAIN = 5.0  # standard deviations, as for errors of the rig
_LESS = 0.9  # of the mean square must be left at most, of every method
_BLOCKS = 10
_ITERATIONS = 5


class Common(NamedTuple):
    """The camera's axes are those of the truth, turned by `turn_rad` (3,); lengths are 1 + `scale` times the true ones.

    Zero is what cannot be told from zero.
    """

    turn_rad: Array
    scale: float

    @property
    def any(self) -> bool:
        """Whether there is any such error."""
        return bool(self.turn_rad.any() or self.scale)

    def applied(self, truth: Array) -> Array:
        """Return the truth (n, 4, 4) with these errors; NaN stay NaN. Its world is that of its first known frame."""
        known = np.flatnonzero(known_frames(truth))
        if not self.any or not len(known):
            return truth
        turn = se3.exp(np.concatenate([np.zeros(3), self.turn_rad]))
        moved = truth.copy()
        moved[known] = se3.inverse(turn) @ (se3.inverse(truth[known[0]]) @ truth[known]) @ turn
        moved[:, :3, 3] *= 1 + self.scale
        return moved

    def in_words(self) -> str:
        """Say what all methods share; empty where that is nothing."""
        turn = f"a turn of the axes by {np.degrees(np.linalg.norm(self.turn_rad)):.2g}°" if self.turn_rad.any() else ""
        length = f"lengths that are {100 * abs(self.scale):.2g} % too {'long' if self.scale > 0 else 'short'}"
        return " and ".join(filter(None, [turn, length if self.scale else ""]))


NONE = Common(np.zeros(3), 0.0)


def common_errors(methods: Sequence[Array], truth: Array) -> Common:
    """Return what all methods' poses (n, 4, 4) have in common against the truth (n, 4, 4).

    Only what ten blocks of the log agree on, and what reduces the errors of every method.
    """
    span = max(1, int(known_frames(truth).sum()) // (2 * _BLOCKS))
    known = np.logical_and.reduce([known_frames(poses) for poses in (truth, *methods)])
    rows = np.flatnonzero(known[:-span] & known[span:])
    if len(rows) < 2 * _BLOCKS or not methods:
        return NONE
    estimated = [se3.inverse(poses[rows]) @ poses[rows + span] for poses in methods]
    found, var = _fitted(estimated, truth, rows, span)
    turn, scale = found[:3], found[3]
    certain_turn = turn @ np.linalg.pinv(var[:3, :3]) @ turn > _CERTAIN**2
    certain_scale = scale**2 > _CERTAIN**2 * var[3, 3]
    common = Common(turn * certain_turn, float(scale * certain_scale))
    if not common.any:
        return NONE
    before, after = (_mean_squares(estimated, poses, rows, span) for poses in (truth, common.applied(truth)))
    return common if (after <= _LESS * before).all() else NONE


def _fitted(estimated: Sequence[Array], truth: Array, rows: Array, span: int) -> tuple[Array, Array]:
    """Return turn and scale (4,) by Gauss-Newton, with their covariance (4, 4) by leaving out one block each."""
    x, normals, sums = np.zeros(4), np.zeros((_BLOCKS, 4, 4)), np.zeros((_BLOCKS, 4))
    for _ in range(_ITERATIONS):
        moved = Common(x[:3], x[3]).applied(truth)
        true = se3.inverse(moved[rows]) @ moved[rows + span]
        t, w = true[:, :3, 3], se3.log_so3(true[:, :3, :3])
        apart_t = np.mean([e[:, :3, 3] for e in estimated], axis=0) - t
        apart_w = np.mean([se3.log_so3(e[:, :3, :3]) for e in estimated], axis=0) - w
        size_t, size_w = (max(float(np.sqrt((d**2).mean())), 1e-12) for d in (apart_t, apart_w))
        by_t = np.concatenate([se3.skew(t), t[:, :, None]], axis=2) / size_t
        by_w = np.concatenate([se3.skew(w), np.zeros_like(t)[:, :, None]], axis=2) / size_w
        j, r = np.concatenate([by_t, by_w], axis=1), np.concatenate([apart_t / size_t, apart_w / size_w], axis=1)
        for k, block in enumerate(np.array_split(np.arange(len(rows)), _BLOCKS)):
            normals[k] = np.einsum("nij,nik->jk", j[block], j[block])
            sums[k] = np.einsum("nij,ni->j", j[block], r[block])
        step = _solved(normals.sum(axis=0), sums.sum(axis=0))
        x = x + step
    without = np.stack(
        [_solved(normals.sum(axis=0) - n, sums.sum(axis=0) - s) for n, s in zip(normals, sums, strict=True)]
    )
    off = without - without.mean(axis=0)
    return x, (_BLOCKS - 1) / _BLOCKS * off.T @ off


def _solved(normal: Array, total: Array) -> Array:
    """Return the least-squares step, 0 where nothing is known, as of a turn about the only direction of motion."""
    found: Array = np.linalg.lstsq(normal, total, rcond=1e-4)[0]
    return found


def _mean_squares(estimated: Sequence[Array], truth: Array, rows: Array, span: int) -> Array:
    true = se3.inverse(truth[rows]) @ truth[rows + span]
    return np.array([((e - true)[:, :3, 3] ** 2).sum(axis=1).mean() for e in estimated])
