"""Stereo video to a log: two files, or one whose frames hold both images. Decoded by OpenCV, written as grey PNG."""

import heapq
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from ..camera.rig import StereoRig, baseline_question
from ..errors import ConfigError, InputError
from ..recording.log_writer import StereoLogWriter
from ..sources.video import Video
from .data_sets import Imported, check_free

Layout: TypeAlias = Literal["left-right", "right-left", "top-bottom", "bottom-top"]
Grey: TypeAlias = NDArray[np.uint8]
_LAYOUTS: tuple[str, ...] = get_args(Layout)
_FASTEST_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1]
_MAX_RATE_HZ = 1e6


def import_video(
    videos: str | Path | Sequence[str | Path],
    calibration: str | Path | Sequence[str | Path],
    out: str | Path,
    rate_hz: float | None = None,
    layout: Layout | None = None,
    *,
    overwrite: bool = False,
) -> Imported:
    """Convert stereo video to a log at `out`.

    `videos`: one file whose frames hold both images, or the files of left and right. `calibration` as in
    `StereoRig.from_calibration`. `layout`: where the images are in a frame; without it left-right or top-bottom, as
    the calibrated size tells. Stamps are those of the container; `rate_hz` puts frames that far apart instead.
    `overwrite`: a file at `out` may be replaced. Raises InputError, ConfigError, OutputError.
    """
    paths = [Path(videos)] if isinstance(videos, str | Path) else [Path(path) for path in videos]
    _check_arguments(paths, rate_hz, layout)
    opened = [Video(path) for path in paths]
    rig = StereoRig.from_calibration(calibration, _image_size(opened, layout))
    chosen = _layout_of(opened, rig, layout)
    check_free(Path(out), paths, overwrite)
    counts = [0, 0]
    with StereoLogWriter(out, rig) as log:
        for stamp_ns, number, picture in _in_order(opened, rate_hz):
            for side, image in enumerate(_split(picture, chosen), start=number):
                done, png = cv2.imencode(".png", image, _FASTEST_PNG)
                assert done  # a grey image of the calibrated size
                log.image(side, stamp_ns, png.tobytes(), "png")
                counts[side] += 1
        for video in opened:
            video.check_complete()
    notes = [note for video in opened for note in video.notes]
    notes += [question] if (question := baseline_question(rig)) else []
    if counts[0] != counts[1]:
        notes.append(f"there are {counts[0]} left and {counts[1]} right frames: they are paired by their times")
    return Imported(Path(out), counts[0], counts[1], 0, notes)


def _split(picture: Grey, layout: str | None) -> tuple[Grey, ...]:
    """The images in a frame: one, or with a layout two, left and right."""
    if layout is None:
        return (picture,)
    first, second = np.split(picture, 2, axis=1 if layout in ("left-right", "right-left") else 0)
    return (first, second) if layout in ("left-right", "top-bottom") else (second, first)


def _layout_of(videos: list[Video], rig: StereoRig, layout: Layout | None) -> str | None:
    """Where the two images of a frame are, None where it is one. Raises InputError where the sizes do not fit."""
    width, height = rig.left.width, rig.left.height
    if len(videos) == 2:
        for video in videos:
            if (video.width, video.height) != (width, height):
                raise InputError(
                    f"{video.path} is {video.width}×{video.height}, the calibration is for {width}×{height}: give the "
                    "calibration of this size",
                    hint=("calibration",),
                )
        return None
    video = videos[0]
    sizes = {"left-right": (2 * width, height), "top-bottom": (width, 2 * height)}
    sizes |= {"right-left": sizes["left-right"], "bottom-top": sizes["top-bottom"]}
    fitting = [name for name, size in sizes.items() if size == (video.width, video.height)]
    if not fitting or (layout is not None and layout not in fitting):
        raise InputError(
            f"{video.path} is {video.width}×{video.height}; two images of the calibrated {width}×{height} side by side "
            f"are {2 * width}×{height}, one above the other {width}×{2 * height}: give the calibration of this size",
            hint=("calibration", "layout"),
        )
    return layout or fitting[0]


def _image_size(videos: list[Video], layout: Layout | None) -> tuple[int, int]:
    """The size of one image, for calibrations that do not tell it; of one file it is a guess by its shape."""
    width, height = videos[0].width, videos[0].height
    if len(videos) == 2:
        return width, height
    beside = layout in ("left-right", "right-left") if layout else width > height
    return (width // 2, height) if beside else (width, height // 2)


def _in_order(videos: list[Video], rate_hz: float | None) -> Iterator[tuple[int, int, Grey]]:
    """Yield stamp, number of the video, and frame, in order of time."""

    def numbered(number: int, video: Video) -> Iterator[tuple[int, int, Grey]]:
        return ((stamp_ns, number, picture) for stamp_ns, picture in video.frames(rate_hz))

    return heapq.merge(*map(numbered, range(len(videos)), videos), key=lambda item: item[:2])


def _check_arguments(paths: list[Path], rate_hz: float | None, layout: str | None) -> None:
    if len(paths) not in (1, 2):
        raise ConfigError(f"{len(paths)} videos were given: give one that holds both images, or left and right")
    if rate_hz is not None and not (math.isfinite(rate_hz) and 0 < rate_hz < _MAX_RATE_HZ):
        raise ConfigError(f"the rate must be a positive number of frames per second, got {rate_hz:g}")
    if layout is not None and layout not in _LAYOUTS:
        raise ConfigError(f"unknown layout {layout!r}; known are {', '.join(_LAYOUTS)}")
    if layout is not None and len(paths) == 2:
        raise ConfigError("a layout is for one video that holds both images: leave it out", hint=("layout",))
