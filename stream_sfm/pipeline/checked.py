"""Checks of what is given to an engine; each error says what was given and what is wanted."""

import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..camera.models import Camera
from ..camera.pixels import image_problem
from ..camera.rig import MonoRig, StereoRig, masked_by
from ..config import Config
from ..errors import ConfigError, FrameError
from ..system.inputs import INT64
from ..system.wording import described
from ..types import Frame, MonoFrame, StereoFrame

# Time between two frames: no camera is faster, and stamps on arrival are further apart. Closer stamps probably
# count milliseconds or frames; σ of a prediction would then be far too small.
_MIN_INTERVAL_NS = 10_000


def used_cameras(rig: StereoRig | MonoRig, config: Config) -> StereoRig | MonoRig:
    """Return the rig to estimate with. `Config.mono` is read only here; everything else asks the rig."""
    rig = masked_by(config, rig)
    if config.mono:
        if isinstance(rig, StereoRig) and rig.timing is not None:
            logging.getLogger("stream_sfm").warning(
                "the calibration's [timing] is not used with one camera: estimates do not know of its readout"
            )
        return MonoRig(rig.left)
    if rig.unscaled:
        raise ConfigError("a rig of one camera needs Config(mono=True); its results have no scale")
    return rig


def check_arguments(rig: object, config: object) -> None:
    """Raise a ConfigError if rig or configuration is of the wrong kind."""
    if not isinstance(rig, StereoRig | MonoRig):
        example = repr(str(rig)) if isinstance(rig, str | Path) else "'calibration.toml'"
        raise ConfigError(
            f"the rig is {described(rig)}; give a StereoRig or a MonoRig, such as StereoRig.from_calibration({example})"
        )
    if not isinstance(config, Config):
        example = repr(str(config)) if isinstance(config, str | Path) else "'settings.toml'"
        raise ConfigError(f"the configuration is {described(config)}; give a Config, such as read_config({example})")


def check_images(cameras: Mapping[str, Camera], frame: Frame, where: str) -> None:
    """Raise a FrameError if the images are not those of the cameras; `where`: which frame it is."""
    if not isinstance(frame, StereoFrame | MonoFrame):
        raise FrameError(f"{where} is {described(frame)}; give a StereoFrame(stamp_ns, left, right)")
    where = f"{where} (stamp {frame.stamp_ns} ns)"
    images = frame.images
    if len(images) < len(cameras):
        raise FrameError(f"{where}: one image only; give a StereoFrame, or estimate with Config(mono=True)")
    for (side, camera), image in zip(cameras.items(), images, strict=False):
        if problem := image_problem(image):
            raise FrameError(f"{where}: the {side} image {problem}")
        if image.shape[:2] != (camera.height, camera.width):
            raise FrameError(
                f"{where}: the {side} image has shape {image.shape}, the calibration says "
                f"({camera.height}, {camera.width}); {_size_fix(image.shape, camera)}"
            )


def checked_stamp(frame: Frame, where: str, last_ns: int | None, is_second: bool) -> int:
    """Return the stamp as a Python integer. Raises FrameError if it is not one after that of the last frame."""
    if isinstance(frame.stamp_ns, bool) or not isinstance(frame.stamp_ns, int | np.integer):
        raise FrameError(f"{where}: stamp_ns is {described(frame.stamp_ns)}; {_stamp_fix(frame.stamp_ns)}")
    stamp_ns = int(frame.stamp_ns)  # differences of small NumPy types overflow
    if not -INT64 <= stamp_ns < INT64:
        raise FrameError(f"{where}: stamp_ns is beyond 64 bits; give an integer number of nanoseconds")
    if last_ns is not None and stamp_ns <= last_ns:
        raise FrameError(
            f"{where} (stamp {stamp_ns} ns): stamps must increase, and the last frame had "
            f"{last_ns} ns; drop this frame, or make a new engine if the clock was set back"
        )
    if is_second and (apart_ns := stamp_ns - (last_ns or 0)) < _MIN_INTERVAL_NS:
        logging.getLogger("stream_sfm").warning(
            f"{where} (stamp {stamp_ns} ns) is {apart_ns} ns after the first one: stamps are nanoseconds; of "
            "milliseconds that is stamp * 10**6, of a frame counter round(count / frames_per_s * 1e9)"
        )
    return stamp_ns


def _stamp_fix(stamp: object) -> str:
    """Say how to convert a stamp of another kind to nanoseconds."""
    fix = "give an integer number of nanoseconds"
    if isinstance(stamp, float | np.floating):
        return f"{fix}: of seconds, round(seconds * 1e9)"
    if hasattr(stamp, "sec") and hasattr(stamp, "nanosec"):
        return f"{fix}: stamp.sec * 10**9 + stamp.nanosec"
    if isinstance(stamp, np.datetime64):
        return f"{fix}: int(stamp.astype('datetime64[ns]').astype(int))"
    if hasattr(stamp, "timestamp"):
        return f"{fix}: round(stamp.timestamp() * 1e9)"
    return fix


def _size_fix(shape: tuple[int, ...], camera: Camera) -> str:
    """Say what to do about an image of another size."""
    height, width = shape[:2]
    if (height, width) == (camera.width, camera.height):
        return "give (h, w), not (w, h): image.T, or the calibration of a camera that stands upright"
    if (height, width) == (camera.height, 2 * camera.width):
        return f"give its halves, if left and right are side by side: image[:, :{camera.width}] and the rest"
    if width * camera.height == height * camera.width:
        return "give images of the calibrated size, or the calibration of this one (K scales with the images)"
    return "give images of the calibrated size, not cropped, or the calibration of this one"
