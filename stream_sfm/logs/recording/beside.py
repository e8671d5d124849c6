"""The calibration of a recording that has none of its own: the only one beside it that fits its images.

A message of zeros is none: with it, drivers of ROS say that a camera is not calibrated.
"""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ...camera.calibration.document import named
from ...camera.rig import MonoRig, StereoRig
from ...errors import ConfigError, LogError
from ...system.wording import some_of
from ..mcap_file.message import Damage, Source
from ..sources.sides import is_camera
from .messages import MessageDecoder, decoded
from .rig import ATTACHMENT, first_sizes
from .survey import Survey


def calibration_beside(source: Source, survey: Survey, mono: bool) -> list[Path] | None:
    """Return the files of the only calibration beside a recording that fits its images.

    None if the recording has its own, or if there is none. Raises LogError if several fit, which it names.
    """
    if _sends_calibration(source, survey):
        return None
    cameras = [topic for topic, count in survey.of_kind("image").items() if is_camera(topic) and count != 0]
    if not cameras or any(a.name.split("/")[-1] == ATTACHMENT for a in source.attachments(Damage())):
        return None
    from ...camera.calibration.read import calibrations_near

    sizes = set(first_sizes(source, cameras).values())
    if len(cameras) == 1 and not mono:  # each image may hold both sides
        sizes |= {half for width, height in sizes for half in ((width // 2, height), (width, height // 2))}
    for found in calibrations_near(source.path):
        fitting: dict[str, list[Path]] = {}
        for files in found:
            if (content := _content(files, sizes, mono)) is not None:
                fitting.setdefault(content, files)
        if len(fitting) > 1:
            listed = some_of([named(files) for files in fitting.values()], "; ")
            raise LogError(
                f"{source.path} has no calibration, and several beside it fit its images: {listed}: give one of them",
                hint=("calibration",),
            )
        if fitting:
            return next(iter(fitting.values()))
    return None


def _sends_calibration(source: Source, survey: Survey) -> bool:
    """Whether the first calibration message of a camera has numbers, or cannot be read."""
    for topic, count in survey.of_kind("calibration").items():
        if count != 0:
            try:
                first = next(decoded(source, [topic], MessageDecoder.calibration), None)
            except LogError:
                return True
            if first is None or first.K.any() or first.P.any():
                return True
    return False


def note_of(files: Sequence[Path]) -> str:
    """Return the sentence that says which calibration is used."""
    return f"the calibration beside the recording is used: {named(files)}"


def _content(files: Sequence[Path], sizes: set[tuple[int, int]], mono: bool) -> str | None:
    """Return what a calibration says, if it is for images of one of these sizes; None if it is not."""
    kind = MonoRig if mono else StereoRig
    for size in sorted(sizes):
        with suppress(ConfigError):
            rig = kind.from_calibration(files, size)
            if (rig.left.width, rig.left.height) == size:
                return rig.to_toml()
    return None
