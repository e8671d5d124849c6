"""Errors that all methods share relative to the truth: a rotation of its first pose, a rotation of axes, and scale.

A truth with a wrong initial heading or in other axes than the camera's, or a wrong baseline, gives every method the
same error, which hides the differences between methods. These errors are therefore fitted to all methods together and
removed. This takes evidence from parts: ten blocks of the log must agree.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from ..rig_model.estimate import CERTAIN
from .relative import known_frames
from .settings import SETTINGS


class Common(NamedTuple):
    """The errors that all methods share; an insignificant error is zero.

    The axes of the camera are those of the truth turned by `turn_rad` (3,); lengths are 1 + `scale` times the true
    ones; the world is that of the truth turned by `start_rad` (3,) about its first position.
    """

    turn_rad: Array
    scale: float
    start_rad: Array

    @property
    def any(self) -> bool:
        """Whether there is any such error."""
        return bool(self.turn_rad.any() or self.scale or self.start_rad.any())

    def applied(self, truth: Array) -> Array:
        """Return the truth (n, 4, 4), which begins with the identity, with these errors added; NaN stay NaN."""
        known = np.flatnonzero(known_frames(truth))
        if not self.any or not len(known):
            return truth
        turn, start = (_rotation(rad) for rad in (self.turn_rad, self.start_rad))
        moved = truth.copy()
        moved[known] = se3.inverse(turn) @ (se3.inverse(truth[known[0]]) @ truth[known]) @ turn
        moved[known[1:]] = start @ moved[known[1:]]
        moved[:, :3, 3] *= 1 + self.scale
        return moved

    def in_words(self) -> str:
        """Say which errors all methods share; empty if there are none."""
        start, turn = (float(np.degrees(np.linalg.norm(rad))) for rad in (self.start_rad, self.turn_rad))
        length = f"lengths that are {100 * abs(self.scale):.2g} % too {'long' if self.scale > 0 else 'short'}"
        found = [
            f"a turn by {start:.2g}° of the first true pose" if start else "",
            f"a turn by {turn:.2g}° of the camera's axes" if turn else "",
            length if self.scale else "",
        ]
        return " and ".join(filter(None, found))


NONE = Common(np.zeros(3), 0.0, np.zeros(3))


def common_errors(methods: Sequence[Array], truth: Array) -> Common:
    """Return what all methods' poses (n, 4, 4) have in common against the truth (n, 4, 4).

    Only corrections that reduce the errors of every method, of motions or of positions, are kept.
    """
    span = max(1, int(known_frames(truth).sum()) // (2 * SETTINGS.blocks))
    known = np.logical_and.reduce([known_frames(poses) for poses in (truth, *methods)])
    rows = np.flatnonzero(known[:-span] & known[span:])
    if len(rows) < 2 * SETTINGS.blocks or not methods:
        return NONE
    common = _of_motions(methods, truth, rows, span)
    return _with_start(common, methods, truth, np.flatnonzero(known))


def _of_motions(methods: Sequence[Array], truth: Array, rows: NDArray[np.intp], span: int) -> Common:
    """Return rotation of the axes and scale from the motions from `rows` over a span: Gauss-Newton from zero."""
    estimated = [se3.inverse(poses[rows]) @ poses[rows + span] for poses in methods]
    x, var = np.zeros(4), np.zeros((4, 4))
    for _ in range(SETTINGS.fits):
        moved = Common(x[:3], x[3], np.zeros(3)).applied(truth)
        true = se3.inverse(moved[rows]) @ moved[rows + span]
        t, w = true[:, :3, 3], se3.log_so3(true[:, :3, :3])
        apart_t = np.mean([e[:, :3, 3] for e in estimated], axis=0) - t
        apart_w = np.mean([se3.log_so3(e[:, :3, :3]) for e in estimated], axis=0) - w
        size_t, size_w = (max(float(np.sqrt((d**2).mean())), 1e-12) for d in (apart_t, apart_w))
        by_t = np.concatenate([se3.skew(t), t[:, :, None]], axis=2) / size_t
        by_w = np.concatenate([se3.skew(w), np.zeros_like(t)[:, :, None]], axis=2) / size_w
        step, var = _fitted(
            np.concatenate([by_t, by_w], axis=1), np.concatenate([apart_t / size_t, apart_w / size_w], axis=1)
        )
        x = x + step
    scale = float(x[3]) if x[3] ** 2 > CERTAIN**2 * var[3, 3] else 0.0
    common = Common(x[:3] * _certain(x[:3], var[:3, :3]), scale, np.zeros(3))
    squares = [
        _mean_squares(estimated, se3.inverse(poses[rows]) @ poses[rows + span])
        for poses in (truth, common.applied(truth))
    ]
    return common if (squares[1] <= SETTINGS.most_left * squares[0]).all() else NONE


def _with_start(common: Common, methods: Sequence[Array], truth: Array, rows: NDArray[np.intp]) -> Common:
    """Add the rotation of the first true pose, from the positions in `rows` relative to the first one.

    Such a rotation also appears in all attitudes. If these disagree, it is drift of the methods.
    """
    moved = common.applied(truth)
    true, *estimated = (se3.inverse(poses[rows[0]]) @ poses[rows] for poses in (moved, *methods))
    positions = true[:, :3, 3]
    away = np.linalg.norm(positions, axis=1)
    far = away > SETTINGS.far_from_start * away.max()
    if far.sum() < 2 * SETTINGS.blocks:
        return common
    apart = np.mean([e[:, :3, 3] for e in estimated], axis=0) - positions
    length = away[far, None]
    x, var = _fitted(-se3.skew(positions[far] / length), apart[far] / length)
    turned = common._replace(start_rad=x)
    by_turn = true, _rotation(x) @ true
    squares = [_mean_squares(estimated, poses) for poses in by_turn]
    rotations = [_mean_squares_of_rotations(estimated, poses) for poses in by_turn]
    real = (
        _certain(x, var)
        and (squares[1] <= SETTINGS.most_left * squares[0]).all()
        and (rotations[1] <= rotations[0]).all()
    )
    return turned if real else common


def _certain(x: Array, var: Array) -> bool:
    """Whether x (3,) differs significantly from zero, by its covariance."""
    size = float(np.linalg.norm(x))
    return size > 0 and size**2 > CERTAIN**2 * float(x @ var @ x) / size**2


def _fitted(by_error: Array, apart: Array) -> tuple[Array, Array]:
    """Return the least-squares errors (m,) of `apart` (n, k) by `by_error` (n, k, m), and their covariance (m, m).

    The covariance comes from leaving out one block each. Unobservable errors, as a turn about the only motion, are
    0.
    """
    blocks = np.array_split(np.arange(len(apart)), SETTINGS.blocks)
    normals = np.stack([np.einsum("nij,nik->jk", by_error[b], by_error[b]) for b in blocks])
    sums = np.stack([np.einsum("nij,ni->j", by_error[b], apart[b]) for b in blocks])
    normal, total = normals.sum(axis=0), sums.sum(axis=0)
    off = np.stack([_solved(normal - n, total - s) for n, s in zip(normals, sums, strict=True)])
    off -= off.mean(axis=0)
    return _solved(normal, total), (SETTINGS.blocks - 1) / SETTINGS.blocks * off.T @ off


def _solved(normal: Array, total: Array) -> Array:
    return np.asarray(np.linalg.lstsq(normal, total, rcond=1e-4)[0], np.float64)


def _rotation(rad: Array) -> Array:
    return se3.exp(np.concatenate([np.zeros(3), rad]))


def _mean_squares(estimated: Sequence[Array], true: Array) -> Array:
    return np.array([((e - true)[:, :3, 3] ** 2).sum(axis=1).mean() for e in estimated])


def _mean_squares_of_rotations(estimated: Sequence[Array], true: Array) -> Array:
    apart = (se3.inverse(true) @ e for e in estimated)
    return np.array([(se3.log_so3(x[:, :3, :3]) ** 2).sum(axis=1).mean() for x in apart])
