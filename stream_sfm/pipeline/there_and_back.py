"""The frames of a run once more, backwards: where it should end shows its drift without ground truth."""

from collections.abc import Generator, Iterator
from contextlib import closing

import numpy as np

from ..evaluation import path_length_m
from ..geometry import se3
from ..recording import StereoPair
from ..recording.images import GreyScaler, decode_grey
from ..types import StereoFrame, Trajectory

RETURN_LIMIT_BYTES = 256 * 2**20  # of recorded images
TOO_LONG = f"the recorded images are more than {RETURN_LIMIT_BYTES // 2**20} MiB"


class WayBack:
    """Keeps the images as recorded; more than `RETURN_LIMIT_BYTES` of them, and none is kept."""

    def __init__(self) -> None:
        self._pairs: list[StereoPair] = []
        self._bytes = 0

    @property
    def too_long(self) -> bool:
        """Whether there will be no way back."""
        return self._bytes > RETURN_LIMIT_BYTES

    def keep(self, pair: StereoPair) -> None:
        """A frame of the way there."""
        self._bytes += len(pair.left.data) + len(pair.right.data)
        if self.too_long:
            self._pairs.clear()
        else:
            self._pairs.append(pair)

    def frames(self) -> Iterator[tuple[StereoPair, StereoFrame]]:
        """From the last but one frame to the first, stamps mirrored at the last."""
        scaler = GreyScaler()
        turn_ns = self._pairs[-1].stamp_ns if self._pairs else 0
        for pair in reversed(self._pairs[:-1]):
            left, right = scaler.to_uint8(decode_grey(pair.left), decode_grey(pair.right))
            yield pair, StereoFrame(2 * turn_ns - pair.stamp_ns, left, right)


def with_return(
    frames: Generator[tuple[StereoPair, StereoFrame], None, None], way_back: WayBack
) -> Generator[tuple[StereoPair, StereoFrame], None, None]:
    """The frames, then their way back."""
    with closing(frames):
        for pair, frame in frames:
            way_back.keep(pair)
            yield pair, frame
    yield from way_back.frames()


def closure(trajectory: Trajectory) -> dict[str, float] | None:
    """What a trajectory there and back, (2n − 1) poses, is off at its end; None where it goes nowhere.

    `end_position_m`, `end_rotation_deg`, the path there and back `path_length_m`, and the first as a share of it in
    percent.
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
