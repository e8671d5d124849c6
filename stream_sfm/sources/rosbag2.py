"""ROS 2 bags as they lie on disk: a folder of one or many files, in MCAP or SQLite, with or without metadata.yaml.

metadata.yaml is written when a recording ends, so a bag of a recorder that crashed has none: its files are then found
by their suffix, and ordered by their content.
"""

import os
import re
import shutil
import tempfile
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zstandard

from ..errors import LogError
from ..inputs import check_text, open_regular, read_small
from .joined import JoinedSource
from .mcap import McapSource
from .source import Source
from .sqlite_bag import SqliteBagSource
from .zstd_messages import ZstdMessages

METADATA = "metadata.yaml"
_READERS: dict[str, Callable[[Path], Source]] = {".mcap": McapSource, ".db3": SqliteBagSource}
# A bag may decompress to so much: images hardly shrink, numbers to a tenth.
_FREE_BYTES, _MAX_RATIO = 2**30, 100
_LISTED = 5  # files named in a message
_MAX_METADATA_BYTES = 2**24  # a bag of ten thousand files has some megabytes of it


def bag_files(folder: Path) -> list[Path]:
    """The files that make up the bag in a folder without metadata.yaml, in natural order; empty where there is none.

    Raises LogError where their names show that they are several recordings: those of one differ in one number, as in
    `walk_0.mcap`, `walk_1.mcap`.
    """
    for suffix in _READERS:
        found = [p for p in folder.iterdir() if p.is_file() and p.name.removesuffix(".zstd").endswith(suffix)]
        if len({re.sub(r"\d+(?=\D*$)", "", p.name.split(".")[0]) for p in found}) > 1:
            listed = ", ".join(sorted(p.name for p in found)[:_LISTED])
            raise LogError(f"{folder} holds several recordings ({listed}, …): name one of them")
        if found:
            return sorted(found, key=_natural_order)
    return []


def open_rosbag2(folder: Path) -> Source:
    """Open a folder with metadata.yaml, or with bag files. Raises LogError where none of its files can be read."""
    metadata, notes = _read_metadata(folder)
    names = [Path(str(name)).name for name in metadata.get("relative_file_paths") or ()]
    files = [folder / name for name in names] or bag_files(folder)
    if not files:
        raise LogError(f"{folder} holds no file of a ROS 2 bag (.mcap, .db3)")
    decompressed = _Decompressed()
    parts: list[Source] = []
    missing: list[str] = []
    for file in files:
        try:
            parts.append(_open_file(file, decompressed))
        except LogError as error:  # often the last file of a recorder that crashed
            missing.append(str(error))
    if not parts:
        raise LogError("; ".join(missing[:_LISTED]))
    bag = JoinedSource(folder, parts, missing, notes)
    decompressed.keep_for(bag)
    by_message = str(metadata.get("compression_mode") or "").lower() == "message"
    return ZstdMessages(bag) if by_message else bag


class _Decompressed:
    """The files of a bag that were compressed as a whole; SQLite and the index of MCAP need to jump in them."""

    def __init__(self) -> None:
        self._folder: Path | None = None

    def file(self, path: Path) -> Path:
        """A decompressed copy of `path` in a temporary folder. Raises LogError."""
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="stream_sfm-"))
            self._remove = weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        target = self._folder / path.stem
        try:
            with open_regular(path) as compressed, target.open("wb") as stream:
                most = max(_FREE_BYTES, _MAX_RATIO * os.fstat(compressed.fileno()).st_size)
                with zstandard.ZstdDecompressor().stream_reader(compressed) as reader:
                    while part := reader.read(2**20):
                        stream.write(part)
                        if stream.tell() > most:
                            raise LogError(
                                f"{path} decompresses to more than {most / 2**30:.0f} GiB: it is damaged"
                            )
        except OSError as error:
            raise LogError(f"cannot decompress {path} to {self._folder}: {error.strerror}") from None
        except zstandard.ZstdError as error:
            raise LogError(f"cannot decompress {path}: {error}") from None
        return target

    def keep_for(self, bag: JoinedSource) -> None:
        """Remove the copies when `bag` is no longer in use."""
        if self._folder is not None:
            self._remove.detach()
            weakref.finalize(bag, shutil.rmtree, self._folder, ignore_errors=True)


def _read_metadata(folder: Path) -> tuple[dict[str, Any], list[str]]:
    """The content of metadata.yaml, empty where there is none that can be read, and notes about that."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    path = folder / METADATA
    if not path.is_file():
        return {}, []
    try:
        text = read_small(path, _MAX_METADATA_BYTES).decode()
        check_text(text)
        content = YAML(typ="safe", pure=True).load(text)
        return dict(content["rosbag2_bagfile_information"]), []
    except (OSError, YAMLError, UnicodeDecodeError, TypeError, KeyError, ValueError, RecursionError) as error:
        return {}, [f"{path} is not used ({f'{error}'.splitlines()[0]}); the files beside it are read"]


def _open_file(path: Path, decompressed: _Decompressed) -> Source:
    if path.suffix == ".zstd":
        path = decompressed.file(path)
    reader = _READERS.get(path.suffix)
    if reader is None:
        raise LogError(
            f"{path}: storage {path.suffix or path.name!r} of ROS 2 is not supported: convert it to mcap"
        )
    return reader(path)


def _natural_order(path: Path) -> list[tuple[int, str]]:
    """bag_2 before bag_10."""
    return [(int(t), "") if t.isdecimal() else (-1, t) for t in re.split(r"(\d+)", path.name) if t]
