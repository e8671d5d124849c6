"""Consistency of relative motions: the factor by which their σ would have to change, for each span, eq. (75).

The error of a pose in the world contains all drift since the start; that of a relative motion depends only on its own
frames. It is compared with its covariance, either against ground truth, which has its own σ, or without truth between
estimates from disjoint parts of the observations (`run/self_test.py`). Against ground truth, the errors of the rig,
which all motions share, are also told apart from those of each motion (`own_and_common.py`).
"""

from array import array
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from ..geometry.linear import mahalanobis2
from ..motion import Motion
from ..types import FrameEstimate, Trajectory
from .association import matched
from .own_and_common import OwnAndCommon, own_and_common
from .settings import SETTINGS

SPANS = (1, 2, 5, 8, 10, 20, 50, 100)
OF_WINDOW = SPANS[:4]  # frames within the window and its covariance
_CHAINED = 10, 20, 50  # composed of these; longer spans are composed of them
_UPPER = np.triu_indices(6)
_NUMBERS = 6 + len(_UPPER[0])  # numbers of a motion and its covariance
_LONGEST = max(SPANS)


class Motions(NamedTuple):
    """Motions over one span of frames that end at the frames `ends` (n,): poses (n, 4, 4) with `cov` (n, 6, 6)."""

    ends: NDArray[np.int64]
    earlier_from_end: Array
    cov: Array


class RelativeRecord:
    """Collects relative motions: some 1700 bytes per frame, and more for the last hundred and every k-th.

    `stamps_ns`, `frame_indices`: of all frames; some indices are missing if a file was damaged.
    """

    def __init__(self) -> None:
        self.stamps_ns, self.frame_indices = array("q"), array("q")
        self._numbers = array("d")  # per frame: a row per span, NaN without a motion
        self._recent: dict[int, dict[int, Motion | None]] = {}  # those of the window, by end frame and span
        self._kept: dict[int, dict[int, Motion]] = {}  # those of every k-th frame, by end frame and span
        self._every = 1

    def add(self, estimate: FrameEstimate) -> None:
        """Add the motions of one estimate; over spans longer than the window, motions of the window are composed."""
        end = estimate.frame_index
        self.stamps_ns.append(estimate.stamp_ns)
        self.frame_indices.append(end)
        self._recent.pop(end - _LONGEST, None)
        self._recent[end] = {span: Motion.of(estimate, span) for span in OF_WINDOW}
        for span in _CHAINED:
            self._recent[end][span] = self._over(span, end)
        found = {k: motion for k, span in enumerate(SPANS) if (motion := self._over(span, end)) is not None}
        numbers = np.full((len(SPANS), _NUMBERS), np.nan)
        if found:
            numbers[list(found), :6] = se3.log(np.stack([m.earlier_from_newest for m in found.values()]))
            numbers[list(found), 6:] = np.stack([m.cov for m in found.values()])[:, *_UPPER]
        self._numbers.frombytes(numbers.tobytes())
        if end % self._every == 0:
            self._kept[end] = {SPANS[k]: motion for k, motion in found.items()}
        if len(self._kept) > SETTINGS.kept_motions:
            self._every *= 2
            self._kept = {end: motions for end, motions in self._kept.items() if end % self._every == 0}

    def _over(self, span: int, end: int) -> Motion | None:
        """Return the motion over a span, composed of as few motions as possible; None if one is missing."""
        motion = None
        for piece in reversed((*OF_WINDOW, *_CHAINED)):
            while span >= piece and piece in self._recent.get(end, {}):
                before = self._recent[end][piece]
                if before is None:
                    return None
                motion = before if motion is None else before.then(motion)
                span, end = span - piece, end - piece
        return None if span else motion

    def motions(self, span: int) -> Motions:
        numbers = np.array(self._numbers).reshape(-1, len(SPANS), _NUMBERS)[:, SPANS.index(span)]
        rows = np.flatnonzero(np.isfinite(numbers[:, 0]))
        cov = np.zeros((len(rows), 6, 6))
        cov[:, _UPPER[0], _UPPER[1]] = cov[:, _UPPER[1], _UPPER[0]] = numbers[rows, 6:]
        return Motions(np.array(self.frame_indices, np.int64)[rows], se3.exp(numbers[rows, :6]), cov)

    def of_one_rig(self, span: int) -> tuple[list[Motion], float]:
        """Return motions over a span, with the common errors of the rig at the end, and how many overlap each."""
        found = [motions[span] for motions in self._kept.values() if span in motions]
        return [m for m in found if m.common_since == found[-1].common_since], max(1.0, span / self._every)


def against_truth(record: RelativeRecord, truth: Trajectory, std_truth: tuple[float, float]) -> list[dict[str, Any]]:
    """Return the factors over all spans with a truth at both ends; `std_truth`: its own σ in m and rad."""
    stamps_ns, indices = (np.array(x, np.int64) for x in (record.stamps_ns, record.frame_indices))
    rows, true = matched(Trajectory(stamps_ns, np.broadcast_to(np.eye(4), (len(stamps_ns), 4, 4))), truth)
    at = np.full(indices.max(initial=-1) + 1, -1)  # rows of the truth by frame index
    at[indices[rows]] = np.arange(len(rows))
    cov_truth = 2 * np.diag(np.repeat(np.square(std_truth), 3))

    def expected(ends: NDArray[np.int64], span: int) -> Array:
        return np.asarray(se3.inverse(true.world_from_cam[at[ends - span]]) @ true.world_from_cam[at[ends]])

    result = []
    for span in SPANS:
        motions = record.motions(span)
        known = (at[motions.ends] >= 0) & (at[motions.ends - span] >= 0)
        if not known.any():
            continue
        poses = motions.earlier_from_end[known]
        error = se3.log(se3.inverse(poses) @ expected(motions.ends[known], span))
        whole = factors(error, motions.cov[known] + cov_truth, poses)
        of_rig, alike = record.of_one_rig(span)
        used = [m for m in of_rig if m.newest is not None and min(at[m.newest], at[m.newest - span]) >= 0]
        parts = OwnAndCommon(None, None, 0.0)
        if used:
            parts = own_and_common(used, expected(np.array([m.newest for m in used]), span), cov_truth, alike)
        result.append({"frames": span, **whole, "factor_own": parts.own, "factor_common": parts.common})
    return result


def over_sigma(spans: Sequence[Mapping[str, Any]]) -> dict[str, float | None]:
    """Return σ in two figures for a whole run: the own part of motions over one frame, and the errors of the rig.

    The latter come from the longest span of the window that shows them.
    """
    of_rig = [f for span in spans if span["frames"] in OF_WINDOW and (f := span["factor_common"]) is not None]
    return {
        "own_motion_over_sigma": spans[0]["factor_own"] if spans else None,
        "rig_over_sigma": of_rig[-1] if of_rig else None,
    }


def factors(error: Array, cov: Array, poses: Array) -> dict[str, Any]:
    """Return the factors by which σ would have to change: overall, for the length, and per axis (translation
    first).

    `error` (n, 6) and `cov` (n, 6, 6) are of the perturbation on the right of `poses` (n, 4, 4).
    """
    nees = mahalanobis2(error, cov)
    along = np.einsum("nji,nj->ni", poses[:, :3, :3], poses[:, :3, 3])
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = along / np.maximum(length, 1e-12)
    var_length = np.einsum("ni,nij,nj->n", along, cov[:, :3, :3], along)
    of_length = np.einsum("ni,ni->n", along, error[:, :3]) ** 2 / np.maximum(var_length, 1e-30)
    axes = np.sqrt(np.mean(error**2 / np.diagonal(cov, axis1=1, axis2=2), axis=0))
    return {
        "count": len(error),
        "factor": float(np.sqrt(nees.mean() / 6)),
        "factor_length": float(np.sqrt(of_length.mean())) if (length > 0).any() else None,
        "factor_axes": axes.tolist(),
    }
