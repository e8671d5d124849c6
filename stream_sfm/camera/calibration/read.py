"""Reads a calibration in any known format, recognised by its content: a file, two files, or the folder they are in."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from ...errors import ConfigError
from ...inputs import read_small
from ..models import Camera
from . import basalt, euroc, kalibr, kitti, opencv, orb_slam, ros, toml_file
from .document import MAX_BYTES, Document, Format, Pair, Size, load

Where: TypeAlias = str | Path | Sequence[str | Path]  # a file, the files of left and right, or a folder

FORMATS: tuple[Format, ...] = (toml_file, kalibr, basalt, orb_slam, ros, euroc, kitti, opencv)
_SUFFIXES = (".toml", ".yaml", ".yml", ".xml", ".json", ".txt", ".npz")
_IN_FOLDERS = ("cam0/sensor.yaml", "cam1/sensor.yaml", "mav0/cam0/sensor.yaml", "mav0/cam1/sensor.yaml")
_SIDES = (("left", "cam0", "camera0"), ("right", "cam1", "camera1"))


def read_pair(where: Where, size: Size | None = None) -> Pair:
    """Left camera, right camera and `right_from_left` (4, 4), metres. Raises ConfigError naming file and key.

    `size` (width, height): of the images, for formats that do not tell it.
    """
    documents = _documents(where)
    module = _format(documents)
    if module.FILES == 2 and len(documents) != 2:
        raise documents[0].error(
            "this is the calibration of one camera: give the files of both, the left one first"
        )
    if module.FILES == 1 and len(documents) != 1:
        raise documents[1].error("this is a second calibration of a pair: give one")
    return module.pair(documents, size)


def read_left(where: Where, size: Size | None = None) -> Camera:
    """The left camera alone; there need not be another. Raises as `read_pair`."""
    documents = _documents(where)
    return _format(documents).left(documents, size)


def parse_pair(content: bytes, name: str | Path) -> Pair:
    """As `read_pair`, of the content of one file that errors call `name`."""
    return _single(content, name).pair([load(content, name)], None)


def parse_left(content: bytes, name: str | Path) -> Camera:
    """As `read_left`, of the content of one file that errors call `name`."""
    return _single(content, name).left([load(content, name)], None)


def named(where: Where) -> str:
    """The path or paths as text, for messages."""
    return str(where) if isinstance(where, str | Path) else " and ".join(map(str, where))


def is_calibration(path: Path) -> bool:
    """Whether a file is a calibration in one of the formats."""
    try:
        return _format_of(load(read_small(path, MAX_BYTES), path)) is not None
    except (OSError, ConfigError):
        return False


def _single(content: bytes, name: str | Path) -> Format:
    module = _format([load(content, name)])
    if module.FILES == 2:
        raise ConfigError(f"calibration {name}: this is the calibration of one camera, of a pair both are needed")
    return module


def _documents(where: Where) -> list[Document]:
    if isinstance(where, list | tuple) and where and all(isinstance(path, str | Path) for path in where):
        return _documents(where[0]) if len(where) == 1 else [_read(Path(path)) for path in where]
    if not isinstance(where, str | Path):
        kind = "None" if where is None else f"of type {type(where).__name__}"
        raise ConfigError(f"the calibration is {kind}; give a file, the files of left and right, or their folder")
    path = Path(where)
    return _in_folder(path) if os.path.isdir(path) else [_read(path)]


def _read(path: Path) -> Document:
    try:
        return load(read_small(path, MAX_BYTES), path)
    except OSError as error:
        raise ConfigError(f"cannot read calibration {path}: {error.strerror}") from None


def _in_folder(folder: Path) -> list[Document]:
    """The calibration in a folder: one file, or the files of left and right. Raises ConfigError."""
    files = sorted(p for p in folder.iterdir() if p.is_file() and p.suffix.lower() in _SUFFIXES)
    files += [folder / name for name in _IN_FOLDERS if (folder / name).is_file()]
    documents = [_read(path) for path in files if is_calibration(path)]
    if not documents:
        raise ConfigError(f"{folder} holds no calibration; known are {_known()}")
    found = [_format_of(document) for document in documents]
    if all(module is found[0] for module in found):
        module = found[0]
        if module is opencv or len(documents) == 1:
            return documents
        if module is not None and module.FILES == 2 and len(documents) == 2:
            return sorted(documents, key=lambda d: _side(d.name))
    listed = ", ".join(Path(d.name).name for d in documents)
    raise ConfigError(f"{folder} holds several calibrations ({listed}): give one of them, or left and right")


def _side(name: str) -> int:
    """0 for the left file of a pair, 1 for the right one, by the end of its path."""
    end = "/".join(Path(name).parts[-2:]).lower()
    positions = [max(end.rfind(word) for word in words) for words in _SIDES]
    return int(positions[1] > positions[0])


def _format(documents: Sequence[Document]) -> Format:
    formats: list[Format] = []
    for document in documents:
        if (found := _format_of(document)) is None:
            raise document.error(f"its keys are of no known format; known are {_known()}")
        formats.append(found)
        if found is not formats[0]:
            raise document.error(f"this is a {found.NAME}, {documents[0].name} is a {formats[0].NAME}")
    return formats[0]


def _format_of(document: Document) -> Format | None:
    if document.is_toml:
        return toml_file
    return next((f for f in FORMATS if f is not toml_file and f.matches(document.data)), None)


def _known() -> str:
    return ", ".join(f.NAME for f in FORMATS)
