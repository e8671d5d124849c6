"""Stereo odometry and local structure from image streams, with covariances one can trust."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# The public names, resolved on first use so that `stream-sfm --help` and a bare import cost nothing.
_PUBLIC = {
    "Camera": "camera.models",
    "Config": "config",
    "Engine": "engine",
    "FrameEstimate": "types",
    "MonoFrame": "types",
    "MonoRig": "camera.rig",
    "Selection": "types",
    "StereoFrame": "types",
    "StereoRig": "camera.rig",
    "Status": "types",
    "Trajectory": "types",
    "ConfigError": "errors",
    "EngineBusyError": "errors",
    "FrameError": "errors",
    "InputError": "errors",
    "LogError": "errors",
    "OutputError": "errors",
    "StreamSfmError": "errors",
    "open_log": "recording",
    "read_config": "config",
    "replay": "pipeline.replay",
}

__all__ = [*sorted(_PUBLIC), "__version__", "viewer"]

if TYPE_CHECKING:
    from . import viewer
    from .camera.models import Camera
    from .camera.rig import MonoRig, StereoRig
    from .config import Config, read_config
    from .engine import Engine
    from .errors import ConfigError, EngineBusyError, FrameError, InputError, LogError, OutputError, StreamSfmError
    from .pipeline.replay import replay
    from .recording import open_log
    from .types import FrameEstimate, MonoFrame, Selection, Status, StereoFrame, Trajectory


def __getattr__(name: str) -> Any:
    if name == "viewer":
        return import_module(".viewer", __name__)
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_PUBLIC[name]}", __name__), name)


def __dir__() -> list[str]:
    return __all__
