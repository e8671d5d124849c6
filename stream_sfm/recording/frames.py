"""Frames of a log: the decoded images, with the messages that they were decoded from."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..types import Picture, StereoFrame
from .messages import ImageMessage
from .pair_reader import StereoPair


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RecordedFrame(StereoFrame):
    """A StereoFrame with the recorded pair it was decoded from; with one camera, left and right are the same."""

    recorded: StereoPair = field(kw_only=True)


def recorded_frame(pair: StereoPair, images: list[NDArray[np.uint8]], stamp_ns: int | None = None) -> RecordedFrame:
    """Make the frame of a pair and its decoded images, at the pair's stamp unless another one is given.

    A viewer gets compressed images as they were recorded, and the decoded grey values of raw ones.
    """
    left, right = images[0], images[-1]
    pictures = _picture(pair.left, left), _picture(pair.right, right)
    return RecordedFrame(pair.stamp_ns if stamp_ns is None else stamp_ns, left, right, pictures, recorded=pair)


def _picture(message: ImageMessage, decoded: NDArray[np.uint8]) -> Picture:
    return message.data if message.compressed else decoded
