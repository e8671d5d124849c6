"""The frames of a run once more, backwards: where it should end shows its drift without ground truth."""

from collections.abc import Generator, Iterator
from contextlib import closing

import numpy as np

from ..evaluation import path_length_m
from ..geometry import se3
from ..recording import RecordedFrame, StereoPair
from ..recording.frames import recorded_frame
from ..recording.images import GreyScaler, decode_grey
from ..types import Trajectory

KEPT_LIMIT_BYTES = 256 * 2**20  # of recorded images
TOO_MANY = f"the recorded images are more than {KEPT_LIMIT_BYTES // 2**20} MiB"


class KeptFrames:
    """Keeps the images of a run as recorded, to feed them backwards; beyond `KEPT_LIMIT_BYTES` none is kept."""

    def __init__(self) -> None:
        self._pairs: list[StereoPair] = []
        self._bytes = 0

    @property
    def too_many(self) -> bool:
        """Whether the images were too large to be kept, so that no frame comes backwards."""
        return self._bytes > KEPT_LIMIT_BYTES

    def keep(self, frame: RecordedFrame) -> None:
        """Keep one frame of the way there."""
        pair = frame.recorded
        self._bytes += len(pair.left.data) + len(pair.right.data)
        if self.too_many:
            self._pairs.clear()
        else:
            self._pairs.append(pair)

    def backwards(self) -> Iterator[RecordedFrame]:
        """From the last but one frame to the first, stamps mirrored at the last."""
        scaler = GreyScaler()
        turn_ns = self._pairs[-1].stamp_ns if self._pairs else 0
        for pair in reversed(self._pairs[:-1]):
            images = scaler.to_uint8(decode_grey(pair.left), decode_grey(pair.right))
            yield recorded_frame(pair, images, stamp_ns=2 * turn_ns - pair.stamp_ns)


def then_backwards(
    frames: Generator[RecordedFrame, None, None], kept: KeptFrames
) -> Generator[RecordedFrame, None, None]:
    """The frames, then the same frames backwards."""
    with closing(frames):
        for frame in frames:
            kept.keep(frame)
            yield frame
    yield from kept.backwards()


def return_error(trajectory: Trajectory) -> dict[str, float] | None:
    """How far a trajectory there and back, (2n − 1) poses, ends from its start; None where it goes nowhere.

    `end_position_m`, `end_rotation_deg`, the path there and back `path_length_m`, and the first relative to it in
    percent, `end_drift_percent`.
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
