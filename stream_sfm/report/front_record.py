"""What all methods of a comparison share: tracks, times, gaps, a few pictures, and how far CC and WC points differ."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array
from ..observer import Observed
from ..types import Frame, FrameEstimate, Observations

MAX_SNAPSHOTS = 6  # kept, of which three are shown; a report stays below a few megabytes
_SNAPSHOT_WIDTH = 560  # pixels; chosen by hand, a compromise between detail and the size of the report
_JPEG_QUALITY = 72
_GAP = 1.6  # times the median of the latest steps in time; chosen by hand, one lost frame makes it 2
_STEPS = 50  # frames over which the median is taken
Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Snapshot:
    """A stereo frame as small JPEGs of the rectified images, with displacements in full-size pixels.

    `stereo` (n, 4) u_left, v_left, u_right, v_right; `temporal` (m, 4) from (u, v) in the previous frame to now.
    """

    frame_index: int
    size: tuple[int, int]
    left_jpeg: bytes
    right_jpeg: bytes
    stereo: Array
    temporal: Array


class FrontRecord:
    """Keeps, frame by frame, what all methods share; `rectify` makes the pictures.

    `lives`: track id -> [first frame, last frame]; `gaps`: frames that follow a gap in time; `local_difference`:
    (frame, median distance of CC and WC local points, metres).
    """

    def __init__(self, rectify: Callable[[Frame], list[Image]] | None = None) -> None:
        self.times_ms: dict[str, list[float]] = {"decode": [], "rectify": [], "frontend": []}
        self.tracked: list[int] = []
        self.new: list[int] = []
        self.lives: dict[int, list[int]] = {}
        self.snapshots: list[Snapshot] = []
        self.gaps: list[int] = []
        self.local_difference: list[tuple[int, float]] = []
        self._rectify = rectify
        self._stride = 1
        self._stamps_ns: list[int] = []  # the latest
        self._previous: Observations | None = None

    def __len__(self) -> int:
        return len(self.tracked)

    def add(self, observed: Observed, frame: Frame, estimates: Mapping[str, FrameEstimate]) -> None:
        """Keep one frame; `estimates`: by method."""
        observations = observed.observations
        index = observations.frame_index
        for stage, times in self.times_ms.items():
            times.append(observed.timings_ms[stage])
        self.tracked.append(len(observations.track_ids) - observations.n_new)
        self.new.append(observations.n_new)
        for track in observations.track_ids.tolist():
            self.lives.setdefault(track, [index, index])[1] = index
        if self._after_a_gap(frame.stamp_ns):
            self.gaps.append(index)
        if self._rectify is not None and index % self._stride == 0:
            self._keep(observations, *self._rectify(frame))
        difference_m = local_difference_m(estimates.get("cross-frame-cc"), estimates.get("cross-frame-wc"))
        if difference_m is not None:
            self.local_difference.append((index, difference_m))
        self._previous = observations

    def _after_a_gap(self, stamp_ns: int) -> bool:
        self._stamps_ns = [*self._stamps_ns[1 - _STEPS :], stamp_ns]
        steps = np.diff(self._stamps_ns)
        return len(steps) > 2 and bool(steps[-1] > _GAP * np.median(steps))

    def _keep(self, observations: Observations, left: Image, right: Image) -> None:
        """Add a snapshot; when there are too many, every second one is dropped and the stride doubles."""
        stereo = observations.z_px[np.isfinite(observations.z_px).all(axis=1)]
        size = left.shape[1], left.shape[0]
        pictures = _jpeg(left), _jpeg(right)
        temporal = _temporal_matches(self._previous, observations)
        self.snapshots.append(Snapshot(observations.frame_index, size, *pictures, stereo, temporal))
        if len(self.snapshots) > MAX_SNAPSHOTS:
            self.snapshots = self.snapshots[::2]
            self._stride *= 2

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


def _temporal_matches(previous: Observations | None, now: Observations) -> Array:
    """Left pixels (m, 4) of the tracks that were seen before: in the previous frame and now."""
    if previous is None:
        return np.empty((0, 4))
    _, i, j = np.intersect1d(previous.track_ids, now.track_ids, return_indices=True)
    return np.concatenate([previous.z_px[i, :2], now.z_px[j, :2]], axis=1)


def _jpeg(grey: Image) -> bytes:
    """A grey image (h, w), reduced to at most `_SNAPSHOT_WIDTH` columns, as JPEG."""
    scale = min(1.0, _SNAPSHOT_WIDTH / grey.shape[1])
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else grey
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1])
