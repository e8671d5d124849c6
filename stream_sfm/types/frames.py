"""Frames of one or two images from cameras, and which frames of a log are used."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError
from ..inertial.samples import ImuSamples
from ..record import record

Image = NDArray[np.uint8] | NDArray[np.uint16]  # (h, w) or (h, w, 1) grey, (h, w, 3) or (h, w, 4) with blue first
Picture = Image | bytes  # an image, or a compressed one (PNG, JPEG, WebP)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StereoFrame:
    """Two images of the same moment as the cameras deliver them: `stamp_ns` an integer.

    Images are uint8 or uint16: grey (h, w) or (h, w, 1), or colour as OpenCV has it, blue first: (h, w, 3), (h, w, 4).

    `pictures`, if given, are shown by a viewer: the same images, for instance as the original JPEG bytes. `imu`:
    the inertial samples since the previous frame, and one beyond, if there are any.
    """

    stamp_ns: int
    left: Image
    right: Image
    pictures: tuple[Picture, ...] = ()
    imu: ImuSamples | None = None

    @property
    def images(self) -> tuple[Image, ...]:
        """Both images."""
        return self.left, self.right

    def __repr__(self) -> str:
        return f"<{type(self).__name__} at {self.stamp_ns} ns, {_size(self.left)} and {_size(self.right)}>"


@record
class MonoFrame:
    """One image of a single camera; everything else is as in StereoFrame."""

    stamp_ns: int
    left: Image
    pictures: tuple[Picture, ...] = ()

    @property
    def images(self) -> tuple[Image, ...]:
        """The one image."""
        return (self.left,)

    def __repr__(self) -> str:
        return f"<MonoFrame at {self.stamp_ns} ns, {_size(self.left)}>"


Frame = StereoFrame | MonoFrame


@dataclass(frozen=True, slots=True)
class Selection:
    """Says which frames of a log are used; without arguments all of them.

    The frames from `start_s` to `end_s`, seconds after the first frame, both included, are selected; of these every
    `stride`-th; of these the first `max_frames`. Raises ConfigError for a selection that cannot contain a frame.
    """

    start_s: float | None = None
    end_s: float | None = None
    max_frames: int | None = None
    stride: int = 1

    def __post_init__(self) -> None:
        for name in ("start_s", "end_s"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, int | float) and 0 <= value < math.inf):
                raise ConfigError(f"{name} is {value!r}; give seconds from the first frame, 0 or more")
        for name in ("max_frames", "stride"):
            value = getattr(self, name)
            if (value is not None or name == "stride") and (not isinstance(value, int) or value < 1):
                raise ConfigError(f"{name} is {value!r}; give a whole number of at least 1")
        if self.start_s is not None and self.end_s is not None and self.end_s < self.start_s:
            raise ConfigError(f"the end, {self.end_s:g} s, lies before the start, {self.start_s:g} s")

    @property
    def is_everything(self) -> bool:
        """Whether no frame is left out."""
        return self == Selection()

    def count(self, frames: int | None) -> int | None:
        """Return the largest number of frames of a log that are used; None if it is not known."""
        if self.start_s is not None or self.end_s is not None or frames is None:
            return self.max_frames
        used = -(-frames // self.stride)
        return used if self.max_frames is None else min(used, self.max_frames)


def _size(image: Image) -> str:
    """Return width × height of an image; the type of anything else, which only an engine refuses."""
    shape = getattr(image, "shape", ())
    return "×".join(map(str, [*shape[1::-1], *shape[2:]])) if len(shape) > 1 else type(image).__name__
