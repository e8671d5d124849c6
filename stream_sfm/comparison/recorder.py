"""Records what the report shows beside the methods: tracking, gaps in time, pictures, and CC against WC points."""

import numpy as np

from ..frontend.prepared import Image
from ..geometry.se3 import Array
from ..observer import Observed, Observer
from ..report.records import FrontRecord, Snapshot
from ..report.thumbnails import jpeg
from ..types import Frame, FrameEstimate, Observations

_SNAPSHOT_WIDTH = 560  # pixels; chosen by hand, a compromise between detail and the size of the report
_GAP = 1.6  # times the median of the latest steps in time; chosen by hand, one lost frame makes it 2
_STEPS = 50  # frames over which the median is taken


class Recorder:
    """Records what all methods share; `local_difference`: (frame, median distance of CC and WC local points, m)."""

    def __init__(self, observer: Observer) -> None:
        self.front = FrontRecord()
        self.local_difference: list[tuple[int, float]] = []
        self._observer = observer
        self._stamps_ns: list[int] = []  # the latest
        self._previous: Observations | None = None

    def take(self, observed: Observed, frame: Frame, estimates: dict[str, FrameEstimate]) -> None:
        """Record one frame; `estimates`: by method."""
        observations = observed.observations
        index = observations.frame_index
        self.front.decode_ms.append(observed.timings_ms["decode"])
        self.front.rectify_ms.append(observed.timings_ms["rectify"])
        self.front.frontend_ms.append(observed.timings_ms["frontend"])
        self.front.add(observations)
        if self._after_a_gap(frame.stamp_ns):
            self.front.gaps.append(index)
        if self.front.wants_snapshot(index):
            self.front.keep(self._snapshot(observations, *self._observer.rectify(frame)))
        difference_m = local_difference_m(estimates.get("cross-frame-cc"), estimates.get("cross-frame-wc"))
        if difference_m is not None:
            self.local_difference.append((index, difference_m))
        self._previous = observations

    def _after_a_gap(self, stamp_ns: int) -> bool:
        self._stamps_ns = [*self._stamps_ns[1 - _STEPS :], stamp_ns]
        steps = np.diff(self._stamps_ns)
        return len(steps) > 2 and bool(steps[-1] > _GAP * np.median(steps))

    def _snapshot(self, observations: Observations, left: Image, right: Image) -> Snapshot:
        stereo = observations.z_px[np.isfinite(observations.z_px).all(axis=1)]
        return Snapshot(
            frame_index=observations.frame_index,
            size=(left.shape[1], left.shape[0]),
            left_jpeg=jpeg(left, _SNAPSHOT_WIDTH),
            right_jpeg=jpeg(right, _SNAPSHOT_WIDTH),
            stereo=stereo,
            temporal=self._temporal_matches(observations),
        )

    def _temporal_matches(self, observations: Observations) -> Array:
        """Return left pixels (m, 4) of the tracks that were seen before: in the previous frame and now."""
        if self._previous is None:
            return np.empty((0, 4))
        _, i, j = np.intersect1d(self._previous.track_ids, observations.track_ids, return_indices=True)
        return np.concatenate([self._previous.z_px[i, :2], observations.z_px[j, :2]], axis=1)


def local_difference_m(cc: FrameEstimate | None, wc: FrameEstimate | None) -> float | None:
    """Return the median distance between the points that two methods have in common; None without any."""
    if cc is None or wc is None:
        return None
    _, i, j = np.intersect1d(cc.track_ids, wc.track_ids, return_indices=True)
    if not len(i):
        return None
    return float(np.median(np.linalg.norm(cc.points_in_cam[i] - wc.points_in_cam[j], axis=1)))
