"""What all methods of a comparison share: tracks, times, gaps, and the distance of CC and WC points."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..observer import Observed
from ..types import Frame, FrameEstimate

_GAP = 1.6  # gap, in median steps of the latest frames; chosen by hand: one lost frame makes it 2
_STEPS = 50  # frames over which the median is taken


class FrontRecord:
    """Keeps, frame by frame, what all methods share.

    `lives`: track id -> [first frame, last frame]; `gaps`: frames that follow a gap in time; `local_difference_m`: for
    each frame the median distance of CC and WC local points.
    """

    def __init__(self) -> None:
        self.times_ms: dict[str, list[float]] = {"decode": [], "rectify": [], "frontend": []}
        self.lives: dict[int, list[int]] = {}
        self.gaps: list[int] = []
        self.local_difference_m: list[float] = []
        self._frames = 0
        self._stamps_ns: list[int] = []  # the latest

    def __len__(self) -> int:
        return self._frames

    def add(self, observed: Observed, frame: Frame, estimates: Mapping[str, FrameEstimate]) -> None:
        """Keep one frame; `estimates`: by method."""
        observations = observed.observations
        index = observations.frame_index
        self._frames += 1
        for stage, times in self.times_ms.items():
            times.append(observed.timings_ms[stage])
        for track in observations.track_ids.tolist():
            self.lives.setdefault(track, [index, index])[1] = index
        if self._after_a_gap(frame.stamp_ns):
            self.gaps.append(index)
        difference_m = local_difference_m(estimates.get("cross-frame-cc"), estimates.get("cross-frame-wc"))
        if difference_m is not None:
            self.local_difference_m.append(difference_m)

    def _after_a_gap(self, stamp_ns: int) -> bool:
        self._stamps_ns = [*self._stamps_ns[1 - _STEPS :], stamp_ns]
        steps = np.diff(self._stamps_ns)
        return len(steps) > 2 and bool(steps[-1] > _GAP * np.median(steps))

    def tracks(self) -> dict[str, Any]:
        """How many points were tracked, and over how many frames."""
        lengths = np.array([last - first + 1 for first, last in self.lives.values()])
        known = len(lengths) > 0
        return {
            "count": len(lengths),
            "mean_frames": float(lengths.mean()) if known else None,
            "median_frames": float(np.median(lengths)) if known else None,
            "longest_frames": int(lengths.max()) if known else None,
        }


def local_difference_m(cc: FrameEstimate | None, wc: FrameEstimate | None) -> float | None:
    """The median distance between the points that two methods have in common; None without any."""
    if cc is None or wc is None:
        return None
    _, i, j = np.intersect1d(cc.track_ids, wc.track_ids, return_indices=True)
    if not len(i):
        return None
    return float(np.median(np.linalg.norm(cc.points_in_cam[i] - wc.points_in_cam[j], axis=1)))
