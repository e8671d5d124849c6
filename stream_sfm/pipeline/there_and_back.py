"""Feeds the frames of a run backwards as well: it should end at its start, which shows drift without ground truth."""

from collections.abc import Generator, Iterator
from contextlib import closing

import numpy as np
from numpy.typing import NDArray

from ..camera.pixels import GreyScaler
from ..evaluation import path_length_m
from ..geometry import se3
from ..recording import RecordedFrame, StereoPair
from ..recording.frames import recorded_frame
from ..recording.images import decode_grey
from ..types import Trajectory

KEPT_LIMIT_BYTES = 256 * 2**20  # of recorded images
TOO_MANY = f"the recorded images are more than {KEPT_LIMIT_BYTES // 2**20} MiB"


class KeptFrames:
    """Keeps the images of a run as recorded, for the way back; if they exceed `KEPT_LIMIT_BYTES`, none is kept."""

    def __init__(self) -> None:
        self._pairs: list[StereoPair] = []
        self._bytes = 0
        self._turn_ns: int | None = None  # the stamp of the last frame, once the way back has begun

    @property
    def too_many(self) -> bool:
        """Whether the images exceeded the limit, so that there is no way back."""
        return self._bytes > KEPT_LIMIT_BYTES

    def keep(self, frame: RecordedFrame) -> None:
        """Keep one frame."""
        pair = frame.recorded
        self._bytes += len(pair.left.data) + len(pair.right.data)
        if self.too_many:
            self._pairs.clear()
        else:
            self._pairs.append(pair)

    def backwards(self) -> Iterator[RecordedFrame]:
        """Yield the last but one frame, then the one before it, up to the first; stamps are mirrored at the last."""
        if not self._pairs:
            return
        scaler = GreyScaler()
        self._turn_ns = turn_ns = self._pairs[-1].stamp_ns
        for pair in reversed(self._pairs[:-1]):
            images = scaler.to_uint8(decode_grey(pair.left), decode_grey(pair.right))
            yield recorded_frame(pair, images, stamp_ns=2 * turn_ns - pair.stamp_ns)

    def are_backwards(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether frames of these stamps (n,) are of the way back: the log may know other things of these moments."""
        return np.zeros(len(stamps_ns), bool) if self._turn_ns is None else np.asarray(stamps_ns > self._turn_ns)


def then_backwards(
    frames: Generator[RecordedFrame, None, None], kept: KeptFrames
) -> Generator[RecordedFrame, None, None]:
    """Yield the frames, then the same frames backwards."""
    with closing(frames):
        for frame in frames:
            kept.keep(frame)
            yield frame
    yield from kept.backwards()


def return_error(trajectory: Trajectory) -> dict[str, float] | None:
    """Return how far a trajectory there and back, (2n − 1) poses, ends from its start; None if it does not move.

    `end_position_m` and `end_rotation_deg`; `path_length_m` of the path there and back; `end_drift_percent`, the
    position relative to that path.
    """
    poses = trajectory.world_from_cam
    path_m = path_length_m(poses)
    if path_m < 1e-3:
        return None
    end = se3.inverse(poses[0]) @ poses[-1]
    position_m = float(np.linalg.norm(end[:3, 3]))
    return {
        "end_position_m": position_m,
        "end_rotation_deg": float(np.degrees(np.linalg.norm(se3.log_so3(end[:3, :3])))),
        "path_length_m": path_m,
        "end_drift_percent": 100 * position_m / path_m,
    }
