"""What a path is, told by its content, and the source that reads it."""

from pathlib import Path

from ..errors import LogError
from ..mcap_file.log_file import LogFile
from .mcap import McapSource
from .source import Source

_START_BYTES = 16  # enough for every magic number below


def open_source(path: str | Path) -> Source:
    """The source for a path. Raises LogError where it cannot be read or is of a kind that is not supported."""
    path = Path(path)
    try:
        str(path).encode()
    except UnicodeEncodeError:  # it could not be named in any result
        raise LogError(f"{str(path)!a}: the name of the file is not UTF-8: rename it") from None
    if path.is_dir():
        raise LogError(
            f"{path} is a folder: give a log (.mcap), or import its images into one", hint=("import_images",)
        )
    try:
        with path.open("rb") as stream:
            start = stream.read(_START_BYTES)
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from None
    if (kind := _other_format(start)) is not None:
        raise LogError(f"{path} is not an MCAP file but {kind}; its first bytes are {start[:8]!r}")
    return McapSource(path, [LogFile(path)])


def _other_format(start: bytes) -> str | None:
    if start.startswith(b"#ROSBAG"):
        return "a ROS 1 bag: convert it with `mcap convert in.bag out.mcap`"
    if start.startswith(b"SQLite"):
        return "a ROS 2 SQLite bag: convert it with `ros2 bag convert` to storage id mcap"
    if start.startswith((b"\x89PNG", b"\xff\xd8\xff")):
        return "an image: import images into a log first"
    if start.startswith(b"RRF"):
        return "a Rerun recording"
    return None
