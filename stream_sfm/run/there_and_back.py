"""The way back of a run: its frames once more, from the last but one to the first, with mirrored stamps."""

from collections.abc import Iterator

from ..camera.pixels import GreyScaler
from ..recording import RecordedFrame, StereoPair
from ..recording.frames import recorded_frame
from ..recording.images import decode_grey

KEPT_LIMIT_BYTES = 256 * 2**20  # of recorded images
TOO_MANY = f"the recorded images are more than {KEPT_LIMIT_BYTES // 2**20} MiB"


class KeptFrames:
    """Keeps the images of a run as recorded, for the way back; if they exceed `KEPT_LIMIT_BYTES`, none is kept."""

    def __init__(self) -> None:
        self._pairs: list[StereoPair] = []
        self._bytes = 0

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
        scaler = GreyScaler()
        for pair in reversed(self._pairs[:-1]):
            images = scaler.to_uint8(decode_grey(pair.left), decode_grey(pair.right))
            yield recorded_frame(pair, images, stamp_ns=2 * self._pairs[-1].stamp_ns - pair.stamp_ns)
