"""What all methods of a comparison share: tracks, times, gaps, and the distance of CC and WC points."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..observer import Observed
from ..recording.pairing import gaps_after
from ..types import Frame, FrameEstimate


class FrontRecord:
    """Keeps, frame by frame, what all methods share.

    `lives`: track id -> [first frame, last frame]; `local_difference_m`: for each frame the median distance of CC and
    WC local points.
    """

    def __init__(self) -> None:
        self.times_ms: dict[str, list[float]] = {"decode": [], "rectify": [], "frontend": []}
        self.lives: dict[int, list[int]] = {}
        self.local_difference_m: list[float] = []
        self._stamps_ns: list[int] = []

    def __len__(self) -> int:
        return len(self.times_ms["decode"])

    @property
    def gaps(self) -> list[int]:
        """Frames that follow a gap in time."""
        return [frame + 1 for frame in gaps_after(self._stamps_ns)]

    def add(self, observed: Observed, frame: Frame, estimates: Mapping[str, FrameEstimate]) -> None:
        """Keep one frame; `estimates`: by method."""
        index = observed.observations.frame_index
        for stage, times in self.times_ms.items():
            times.append(observed.timings_ms[stage])
        for track in observed.observations.track_ids.tolist():
            self.lives.setdefault(track, [index, index])[1] = index
        self._stamps_ns.append(frame.stamp_ns)
        self._compare_points(estimates.get("cross-frame-cc"), estimates.get("cross-frame-wc"))

    def _compare_points(self, cc: FrameEstimate | None, wc: FrameEstimate | None) -> None:
        """Keep the median distance between the points that two methods have in common."""
        if cc is None or wc is None:
            return
        _, i, j = np.intersect1d(cc.track_ids, wc.track_ids, return_indices=True)
        if len(i):
            apart_m = np.linalg.norm(cc.points_in_cam[i] - wc.points_in_cam[j], axis=1)
            self.local_difference_m.append(float(np.median(apart_m)))

    def tracks(self) -> dict[str, Any]:
        """How many points were tracked, and over how many frames."""
        lengths = np.array([last - first + 1 for first, last in self.lives.values()])
        if not len(lengths):
            return {"count": 0, "mean_frames": None, "median_frames": None, "longest_frames": None}
        return {
            "count": len(lengths),
            "mean_frames": float(lengths.mean()),
            "median_frames": float(np.median(lengths)),
            "longest_frames": int(lengths.max()),
        }
