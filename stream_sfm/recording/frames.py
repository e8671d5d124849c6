"""A frame of a log: the decoded images, and the messages they were decoded from."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..types import Picture, StereoFrame
from .messages import ImageMessage
from .pair_reader import StereoPair


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RecordedFrame(StereoFrame):
    """A StereoFrame with what was recorded, not decoded. Of a log of one camera, left and right are the same."""

    recorded: StereoPair = field(kw_only=True)


def recorded_frame(pair: StereoPair, images: list[NDArray[np.uint8]], stamp_ns: int | None = None) -> RecordedFrame:
    """The frame of a pair and its decoded images, at the pair's stamp unless another one is given.

    Compressed images are shown as they were recorded, raw ones as the grey values that were decoded.
    """
    left, right = images[0], images[-1]
    pictures = _picture(pair.left, left), _picture(pair.right, right)
    return RecordedFrame(pair.stamp_ns if stamp_ns is None else stamp_ns, left, right, pictures, recorded=pair)


def _picture(message: ImageMessage, decoded: NDArray[np.uint8]) -> Picture:
    return message.data if message.compressed else decoded
