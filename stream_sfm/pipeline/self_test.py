"""A test of covariances without any truth: estimates from disjoint halves of the observations must agree within them.

Even against odd tracks; and tracks born in the left half of the image against those of the right half, which sees also
what neighbouring tracks share, such as the lens. What both halves share altogether, above all the baseline, no such
test can see. Each half is estimated by a window of its own, from the front-end's one set of observations.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..estimators import make_estimator
from ..evaluation.relative_consistency import factors
from ..geometry import se3
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..types import Observations, RelativeMotions, Status

SPANS = (1, 2, 5, 8)
Mask = NDArray[np.bool_]


class SelfTest:
    """Takes observations frame by frame; `result` has the factors of both tests over each span."""

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self._halves = {
            "tracks": _Halves(projection, config, _even),
            "image": _Halves(projection, config, _LeftHalf(projection.width)),
        }

    def add(self, observations: Observations) -> None:
        """Estimate the next frame from each half."""
        for halves in self._halves.values():
            halves.add(observations)

    def result(self) -> dict[str, list[dict[str, Any]]]:
        """Test -> for each span with motions of both halves: `frames`, `count`, `factor`, `factor_axes` …"""
        return {name: halves.result() for name, halves in self._halves.items()}


class _Halves:
    """Two estimators on disjoint parts of the tracks, and how far they are apart."""

    def __init__(self, projection: StereoProjection, config: Config, first: Callable[[Observations], Mask]) -> None:
        self._first = first
        self._estimators = [make_estimator("cross-frame", projection, config) for _ in range(2)]
        self._apart: dict[int, list[tuple[Array, Array, Array]]] = {span: [] for span in SPANS}

    def add(self, observations: Observations) -> None:
        first = self._first(observations)
        a, b = (
            estimator.step(_part(observations, rows))
            for estimator, rows in zip(self._estimators, (first, ~first), strict=True)
        )
        if Status.LOST in (a.status, b.status) or a.relative is None or b.relative is None:
            return
        for span, apart in self._apart.items():
            index = observations.frame_index - span
            one, other = _motion(a.relative, index), _motion(b.relative, index)
            if one is not None and other is not None:
                error = se3.log(se3.inverse(one[0]) @ other[0])
                apart.append((error, one[1] + other[1], one[0]))

    def result(self) -> list[dict[str, Any]]:
        result = []
        for span, apart in self._apart.items():
            if apart:
                error, cov, poses = (np.stack(part) for part in zip(*apart, strict=True))
                result.append({"frames": span, **factors(error, cov, poses)})
        return result


def _even(observations: Observations) -> Mask:
    return observations.track_ids % 2 == 0


class _LeftHalf:
    """Which tracks were born in the left half of the image."""

    def __init__(self, width: int) -> None:
        self._middle_px = (width - 1) / 2
        self._ids, self._left = np.empty(0, np.int64), np.empty(0, bool)

    def __call__(self, observations: Observations) -> Mask:
        left: Mask = np.asarray(observations.z_px[:, 0] < self._middle_px)
        _, old, now = np.intersect1d(self._ids, observations.track_ids, return_indices=True)
        left[now] = self._left[old]
        self._ids, self._left = observations.track_ids, left
        return left


def _part(observations: Observations, rows: Mask) -> Observations:
    """The observations of some tracks."""
    o, n_old = observations, len(observations.track_ids) - observations.n_new
    return replace(
        o,
        track_ids=o.track_ids[rows],
        z_px=o.z_px[rows],
        cov_px=o.cov_px[rows],
        n_new=int(np.count_nonzero(rows[n_old:])),
        std_drift_px=None if o.std_drift_px is None else o.std_drift_px[rows],
        inflation=None if o.inflation is None else o.inflation[rows],
        rig_effects=None if o.rig_effects is None else o.rig_effects[rows],
    )


def _motion(relative: RelativeMotions, index: int) -> tuple[Array, Array] | None:
    row = np.flatnonzero(relative.frame_indices == index)
    return (relative.frame_from_newest[row[0]], relative.cov[row[0]]) if len(row) else None
