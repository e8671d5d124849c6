"""ROS 2 bags on disk: a folder of one or many files, in MCAP or SQLite, with or without metadata.yaml.

metadata.yaml is written when a recording ends, so a bag of a crashed recorder has none. Its files are then found
by their suffix and ordered by their content. Files and messages may be compressed with zstd.
"""

import os
import re
import tempfile
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import IO

import zstandard

from ...errors import LogError, as_error
from ...system.inputs import LIMITS, open_regular, read_small
from ...system.wording import some_of
from ..mcap_file.log_file import LogFile
from ..mcap_file.message import Source
from .containers.sqlite_bag import SqliteBagSource, connect
from .joined import JoinedSource, natural_order

_SUFFIXES = (".mcap", ".db3")
# Limit on the total content of compressed files: images hardly shrink, and numbers shrink to a tenth.
_FREE_BYTES, _MAX_RATIO = 2**29, 20
# The parts that are read of metadata.yaml, as recorders write it. A YAML parser would take minutes for a long file,
# and aliases could make it run forever.
_FILES = re.compile(r"^ *relative_file_paths: *\n((?: *- +[^\n]*\n?)+)", re.MULTILINE)
_BY_MESSAGE = re.compile(r"^ *compression_mode: *[\"']?message\b", re.MULTILINE | re.IGNORECASE)


def bag_files(folder: Path) -> list[Path]:
    """Return the files of the bag in a folder without metadata.yaml, in natural order; empty if there is none.

    Raises LogError if their names belong to several recordings: those of one differ in one number, as in
    `walk_0.mcap`, `walk_1.mcap`.
    """
    for suffix in _SUFFIXES:
        found = [p for p in folder.iterdir() if p.is_file() and p.name.removesuffix(".zstd").endswith(suffix)]
        if len({re.sub(r"\d+(?=\D*$)", "", p.name.split(".")[0]) for p in found}) > 1:
            listed = some_of(sorted(p.name for p in found))
            raise LogError(f"{folder} holds several recordings ({listed}): name one of them")
        if found:
            return sorted(found, key=lambda p: natural_order(p.name))
    return []


def open_rosbag2(folder: Path) -> Source:
    """Open a folder with metadata.yaml, or with bag files. Raises LogError if none of its files can be read."""
    names, by_message, notes = _read_metadata(folder)
    files = [folder / name for name in names] or bag_files(folder)
    if not files:
        raise LogError(f"{folder} holds no file of a ROS 2 bag (.mcap, .db3)")
    compressed = _Decompressor(files)
    parts: list[Source] = []
    missing: list[str] = []
    for file in files:
        try:
            parts.append(compressed.open(file) if file.suffix == ".zstd" else _open_plain(file))
        except LogError as error:  # often the last file of a crashed recorder
            missing.append(str(error))
    if not parts:
        raise LogError(some_of(missing, "; "))
    return JoinedSource(folder, parts, missing, notes, by_message)


def _read_metadata(folder: Path) -> tuple[list[str], bool, list[str]]:
    """Return the names of the files, whether each message is compressed, and what is wrong with metadata.yaml."""
    path = folder / "metadata.yaml"
    if not path.is_file():
        return [], False, []
    problem = "it lists no files"
    try:
        text = read_small(path, LIMITS.metadata_bytes).decode()
        listed = _FILES.search(text)
        names = [line.strip().removeprefix("-").strip(" \"'") for line in listed[1].splitlines()] if listed else []
        if len(names) > LIMITS.files:
            problem = f"it lists more than {LIMITS.files} files"
        elif names and not any(name.startswith(("*", "&")) for name in names):  # YAML's aliases and anchors
            return [Path(name).name for name in names], _BY_MESSAGE.search(text) is not None, []
    except (OSError, UnicodeDecodeError) as error:
        problem = f"{error}"
    return [], False, [f"{path} is not used ({problem}); the files beside it are read"]


def _open_plain(path: Path) -> Source:
    if path.suffix not in _SUFFIXES:
        raise LogError(f"{path}: ROS 2 storage {path.suffix or path.name!r} is not supported: convert it to mcap")
    return LogFile(path) if path.suffix == ".mcap" else SqliteBagSource(path)


_OPEN_FILES = "/proc/self/fd"  # on Linux, opens a file without a name again for each reading


class _Decompressor:
    """Opens files that were compressed as a whole, as decompressed copies without a name, which end with the process.

    SQLite and the index of MCAP need random access to them. The total content is limited in proportion to their size.
    """

    def __init__(self, files: list[Path]) -> None:
        sizes = [path.stat().st_size for path in files if path.suffix == ".zstd" and path.is_file()]
        self._left = _FREE_BYTES + _MAX_RATIO * sum(sizes)

    def open(self, path: Path) -> Source:
        """Return the source in a compressed file. Raises LogError."""
        kind = Path(path.stem).suffix
        if kind not in _SUFFIXES:
            return _open_plain(Path(path.stem))  # this reports that it is not supported
        with _decompressing(path):
            descriptor, name = tempfile.mkstemp(prefix="stream_sfm-", suffix=kind)
        with os.fdopen(descriptor, "w+b") as copy:
            # SQLite opens a file by its name and reads it at the first query, so both come before the name is
            # removed.
            database = connect(Path(name), "mode=ro") if kind == ".db3" else None
            unnamed = database is not None or os.path.isdir(_OPEN_FILES)
            if unnamed:
                os.unlink(name)
            try:
                size = self._decompress(path, copy)
            except LogError:
                if not unnamed:
                    os.unlink(name)
                raise
            if database is None and unnamed:
                kept = os.dup(copy.fileno())
                return LogFile(path, f"{_OPEN_FILES}/{kept}", partial(os.close, kept))
            if database is None:  # as on macOS, where an open file cannot be opened again
                return LogFile(path, name, partial(os.unlink, name))
            # SQLite's two versions: 1 with a rollback journal, 2 with a write-ahead log, which is not beside a copy
            os.pwrite(copy.fileno(), b"\1\1", 18)
            return SqliteBagSource(path, database, size)

    def _decompress(self, path: Path, copy: IO[bytes]) -> int:
        with _decompressing(path):
            with open_regular(path) as stream, zstandard.ZstdDecompressor().stream_reader(stream) as reader:
                while part := reader.read(2**20):
                    self._left -= copy.write(part)
                    if self._left < 0:
                        raise LogError(f"{path} decompresses to far more than a recording does: it is damaged")
            copy.flush()
            return copy.tell()


def _decompressing(path: Path) -> AbstractContextManager[None]:
    return as_error(LogError, f"cannot decompress {path} to {tempfile.gettempdir()}", OSError, zstandard.ZstdError)
