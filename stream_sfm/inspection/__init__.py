"""Inspection of a log before a replay: its contents, the stereo pair, and whether the calibration fits the images."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__all__ = ["inspect_log"]

if TYPE_CHECKING:
    from .overview import inspect_log


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(".overview", __name__), name)
