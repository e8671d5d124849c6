"""Errors of test points in the world (global structure), the paper's Figure 7 (c) and (f).

The paper surveyed some points of its scenes. Here a depth image does so: a tenth of the points are test points, and
the true place of each in the world follows from the depth on its ray when it is first compared, and from the true pose
of that frame. Afterwards its estimated place is compared with this place in every frame in which it is seen. Sideways
it is where it was estimated first, which is exact to a fraction of a pixel.
"""

from array import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from ..geometry.linear import mahalanobis2
from ..geometry.medians import median
from ..types import FrameEstimate, Trajectory
from .association import truth_of_frames
from .relative import known_frames
from .settings import SETTINGS

GLOBAL_FIGURES = ("global_structure_rms_m", "global_structure_median_m", "global_structure_error_over_sigma")


class TestPoints:
    """Collects the estimated places of test points, and the true place of each in the camera that saw it first."""

    __test__ = False  # not a test for pytest

    def __init__(self) -> None:
        self._begun: dict[int, tuple[int, Array]] = {}  # by id: the stamp of the first frame, and the place there
        self._stamps_ns, self._ids, self._numbers = array("q"), array("q"), array("d")

    def add(self, estimate: FrameEstimate, rows: NDArray[np.intp], true_in_cam: Array) -> None:
        """Add a frame, in which the points in `rows` of the estimate are at `true_in_cam` (m, 3) along their rays."""
        if not len(rows) and not self._begun:
            return
        ids = estimate.track_ids
        for row, place in zip(rows, true_in_cam, strict=True):
            if ids[row] % SETTINGS.test_points == 0:
                self._begun.setdefault(int(ids[row]), (estimate.stamp_ns, place))
        seen = np.array([k for k, each in enumerate(ids.tolist()) if each in self._begun], np.intp)
        self._stamps_ns.extend([estimate.stamp_ns] * len(seen))
        self._ids.extend(ids[seen].tolist())
        numbers = [estimate.points_in_world[seen], estimate.cov_points_in_world[seen].reshape(-1, 9)]
        self._numbers.frombytes(np.concatenate(numbers, axis=1).tobytes())

    def errors(self, estimate: Trajectory, truth: Trajectory) -> tuple[NDArray[np.int64], Array, Array]:
        """Return stamps (k,), errors (k, 3) in axes of the first camera, m, and NEES (k,), 3 expected.

        First poses are aligned. Only frames with a true pose are compared, and none if the first frame has none.
        """
        true = truth_of_frames(estimate.stamps_ns, truth)
        stamps_ns = np.array(self._stamps_ns, np.int64)
        known = known_frames(true)
        if not len(stamps_ns) or not known[0]:
            return np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0)
        begun = [self._begun[track] for track in self._ids]
        first_ns, places = np.array([ns for ns, _ in begun], np.int64), np.stack([place for _, place in begun])
        at, at_first = (np.searchsorted(estimate.stamps_ns, ns) for ns in (stamps_ns, first_ns))
        used = known[at] & known[at_first]
        first_from_world = se3.inverse(estimate.world_from_cam[0])
        first_from_cam = se3.inverse(true[0]) @ true[at_first[used]]
        numbers = np.array(self._numbers).reshape(-1, 3 + 9)[used]
        found = se3.transform(first_from_world, numbers[:, :3])
        error = found - np.einsum("nij,nj->ni", first_from_cam[:, :3, :3], places[used]) - first_from_cam[:, :3, 3]
        turn = first_from_world[:3, :3]
        return stamps_ns[used], error, mahalanobis2(error, turn @ numbers[:, 3:].reshape(-1, 3, 3) @ turn.T)

    def figures(self, estimate: Trajectory, truth: Trajectory) -> dict[str, Any]:
        """Return RMS and median of the errors, m, and their RMS in σ per axis; NaN without any."""
        _, error, nees = self.errors(estimate, truth)
        if not len(error):
            return dict.fromkeys(GLOBAL_FIGURES, np.nan)
        length = np.linalg.norm(error, axis=1)
        values = np.sqrt((length**2).mean()), median(length), np.sqrt(nees.mean() / 3)
        return dict(zip(GLOBAL_FIGURES, map(float, values), strict=True))
