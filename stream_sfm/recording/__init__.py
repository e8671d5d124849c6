"""A recording as a stereo log: which topics are the cameras, how they are calibrated, and their frames in order.

`open_log` is the way in; the page to read first is `stereo_log.py`. Names are resolved on first use, so that
importing this package costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

_PUBLIC = {
    "ImageMessage": "messages",
    "ReadStats": "pair_reader",
    "RecordedFrame": "frames",
    "StereoLog": "stereo_log",
    "StereoPair": "pair_reader",
    "open_camera": "stereo_log",
    "open_log": "stereo_log",
}

__all__ = ["ImageMessage", "ReadStats", "RecordedFrame", "StereoLog", "StereoPair", "open_camera", "open_log"]

if TYPE_CHECKING:
    from .frames import RecordedFrame
    from .messages import ImageMessage
    from .pair_reader import ReadStats, StereoPair
    from .stereo_log import StereoLog, open_camera, open_log


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_PUBLIC[name]}", __name__), name)
