"""Recognises a path by its content, and opens the source that reads it.

Only the source of MCAP is imported in advance: most logs are MCAP, and importing all others takes 20 ms.
"""

import os
import re
from contextlib import suppress
from itertools import islice
from pathlib import Path

from ...errors import ConfigError, LogError
from ...system.inputs import open_regular, reading
from ...system.wording import LISTED, described, some_of
from ..mcap_file.log_file import LogFile
from ..mcap_file.message import Source
from ..mcap_file.records import MAGIC as MCAP_MAGIC
from ..mcap_file.records import ends_with_magic
from .containers import containers
from .given import Given
from .image_header import image_format

_OTHER_FILES = (
    ((b"RRF",), "a Rerun recording: give the log that it was made from"),
    ((b"\x28\xb5\x2f\xfd",), "compressed with zstd: decompress it with `zstd -d`"),
    ((b"PK\x03\x04", b"\x1f\x8b", b"7z\xbc\xaf"), "an archive: unpack it and give the folder or the file in it"),
)
_BAG_METADATA = "metadata.yaml"  # marks the folder of a ROS 2 bag
_WITHOUT_STAMPS = ("image files", "TartanAir")  # formats
_RESULT = "estimates.mcap"  # of a run
_LEVELS = 4  # of folders that are searched for a recording: dataset/sequences/00, Scene01/clone/frames/rgb
_MOST_ENTRIES = 1000  # per level that are searched
_LONGEST_START = 512  # bytes


def supported() -> str:
    """Return the supported kinds of recordings, for messages."""
    from .data_sets import known_data_sets

    kinds, (*names, last) = [kind.name for kind in containers() if kind.name], known_data_sets()
    return (
        f"an MCAP file, {', '.join(kinds)}, a {', '.join(names)} or {last} recording, images or videos of left and "
        "right in a folder"
    )


def open_source(path: str | Path, calibrated: bool = False, rate_hz: float | None = None, mono: bool = False) -> Source:
    """Open the recording at `path`. Raises LogError if it cannot be read or is not a recording.

    `calibrated`: the calibration in a folder is not used, and may be broken; `rate_hz`: of images without stamps;
    `mono`: one camera will do. Raises ConfigError for a rate where there are stamps.
    """
    if not isinstance(path, str | Path):
        raise LogError(f"the log is {described(path)}; give the path of a file or a folder")
    path = Path(path)
    try:
        str(path).encode()
    except UnicodeEncodeError:  # no result could name it
        raise LogError(f"{str(path)!a}: the name of the file is not UTF-8: rename it") from None
    source = _open_folder(path, Given(calibrated, rate_hz, mono)) if os.path.isdir(path) else _open_file(path)
    if rate_hz is not None and source.format not in _WITHOUT_STAMPS:
        raise ConfigError(f"{path}: a rate was given, but a recording of this kind ({source.format}) has stamps")
    return source


def is_recording(path: Path) -> bool:
    """Whether a file, by its name, or a folder, by its content, is a recording as a whole."""
    if not path.is_dir():
        suffixes = (".mcap", *(kind.suffix for kind in containers() if kind.suffix))
        return path.name.removesuffix(".zstd").endswith(suffixes)
    if (path / _RESULT).is_file():  # also a bag, but of estimates
        return False
    from .data_sets import is_data_set

    if (path / _BAG_METADATA).is_file() or is_data_set(path):
        return True
    # A bag that its ROS 2 recorder could not close has files named after the folder, but no metadata.
    files = [p.name for p in path.iterdir() if p.is_file()]
    return bool(files) and all(re.fullmatch(rf"{re.escape(path.name)}_\d+\.(mcap|db3)(\.zstd)?", n) for n in files)


def _open_file(path: Path) -> Source:
    with reading(path), open_regular(path) as stream:
        start = stream.read(_LONGEST_START)
        ends_as_mcap = ends_with_magic(stream)
    if start.startswith(b"SVO") or path.suffix.lower() == ".svo2":  # MCAP, with images in a form of its own
        raise LogError(f"{path} is a ZED recording: export it with the ZED tools to a video that holds both images")
    if start.startswith(MCAP_MAGIC):
        return LogFile(path)
    for kind in containers():
        if re.match(kind.start, start):
            return kind.open(path)
    if path.name == _BAG_METADATA:
        return _open_folder(path.parent, Given())
    if ends_as_mcap:  # its start is damaged
        return LogFile(path)
    if image_format(start):
        problem = f"{path} is an image: give the folder of a recording, or import images into a log"
        raise LogError(problem, hint=("import_images",))
    for magics, what in _OTHER_FILES:
        if start.startswith(magics):
            raise LogError(f"{path} is {what}")
    if not start:
        raise LogError(f"{path} is empty (0 bytes): nothing was recorded")
    raise LogError(f"{path} is not a recording ({supported()}); its first bytes are {start[:8]!r}")


def _recordings_in(folder: Path) -> list[Path]:
    """Return the recordings in a folder or, if there are none, in those below, as in an unpacked data set."""
    level = [folder]
    for _ in range(_LEVELS):
        entries = list(islice((entry for below in level for entry in _visible(below)), _MOST_ENTRIES))
        if found := [entry for entry in entries if is_recording(entry)]:
            return found
        level = [entry for entry in entries if entry.is_dir() and not entry.is_symlink()]
    return []


def _visible(folder: Path) -> list[Path]:
    """Return the content of a folder except hidden entries and results; nothing if it cannot be read."""
    with suppress(OSError):
        return [p for p in sorted(folder.iterdir()) if not p.name.startswith(".") and p.name != _RESULT]
    return []


def _open_folder(path: Path, given: Given) -> Source:
    from .data_sets import open_folder, videos_in
    from .image_sets import image_folders
    from .rosbag2 import bag_files, open_rosbag2

    with reading(path):
        if (path / _BAG_METADATA).is_file():
            return open_rosbag2(path)
        if (found := open_folder(path, given)) is not None:
            return found
        if bag_files(path):
            return open_rosbag2(path)
    inside = _recordings_in(path)
    if len(inside) == 1:
        return open_source(inside[0], given.calibrated, given.rate_hz, given.mono)
    if inside:
        problem = f"{path} holds several recordings: give one of {some_of(list(map(str, inside)))}"
        raise LogError(problem, hint=("replay_batch",))
    listed = [f"{folder} ({count})" for folder, count in islice(image_folders(path), LISTED)]
    which = "give the one of a single camera" if given.mono else "of which no names tell left from right"
    images = f"; there are images in {some_of(listed)}, {which}" if listed else ""
    hint = () if given.mono else ("import_images",)
    if videos := list(map(str, videos_in(path))):
        names = f"of its videos, {some_of(videos)}, no names tell left from right"
        images = f"; {names}: name them left.mp4 and right.mp4"
        hint = ()
    raise LogError(f"{path} is a folder without a recording ({supported()}){images}", hint=hint)
