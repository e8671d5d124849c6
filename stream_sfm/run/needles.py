"""Keeps one frame of a run with the matches of its points, for the paper's Figure 4."""

from collections.abc import Mapping

import numpy as np

from ..pipeline.observer import Observed, Observer
from ..report.matches import Needles
from ..types import Frame, FrameEstimate, Observations, Sink


class NeedlesOfFrame(Sink):
    """A check and a sink of a run: `found` are the matches of the frame `wanted`, None before it."""

    def __init__(self, observer: Observer, wanted: int) -> None:
        self._observer, self._wanted = observer, wanted
        self._before: Observations | None = None
        self._now: Observations | None = None
        self.found: Needles | None = None

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        """Take the observations of a frame; `write` follows with its images."""
        if self.found is None:
            self._before, self._now = self._now, observed.observations

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Take the images of the same frame."""
        before, now = self._before, self._now
        if estimate.frame_index != self._wanted or before is None or now is None:
            return
        both = np.isfinite(now.z_px).all(axis=1)  # others were seen by the left camera alone
        _, i, j = np.intersect1d(before.track_ids, now.track_ids, return_indices=True)
        self.found = Needles(
            frame=self._wanted,
            image=self._observer.prepare(frame).rectified[0],
            stereo_px=now.z_px[both].reshape(-1, 2, 2),
            temporal_px=np.stack([before.z_px[i, :2], now.z_px[j, :2]], axis=1),
            used=np.isin(now.track_ids[both], estimate.rejected_ids, invert=True),
            used_again=np.isin(now.track_ids[j], estimate.rejected_ids, invert=True),
        )
