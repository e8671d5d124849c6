"""Reads a calibration in any known format, recognised by its content: a file, two files, or the folder they are in."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ...errors import ConfigError, as_error
from ...system.inputs import LIMITS, read_small
from ...system.wording import described
from ..models import Camera
from ..settings import SETTINGS
from .document import Document, Format, Pair, Size, Where, load
from .inertial import is_imu_file
from .makers import MRPT, OAK, ZED
from .projections import KITTI, OPENCV, ROS
from .slam import BASALT, EUROC, KALIBR, ORB_SLAM, VINS
from .toml_file import TOML

FORMATS: tuple[Format, ...] = (TOML, KALIBR, BASALT, ORB_SLAM, VINS, ROS, EUROC, KITTI, OAK, ZED, MRPT, OPENCV)
_SUFFIXES = (".toml", ".yaml", ".yml", ".xml", ".json", ".txt", ".npz", ".conf")
_IN_FOLDERS = ("cam0/sensor.yaml", "cam1/sensor.yaml", "mav0/cam0/sensor.yaml", "mav0/cam1/sensor.yaml")
_NAMES_A_FILE = re.compile(r"relative_config_imu(cam)?|cam[01]_calib")
_NEAR = re.compile("calib|config|settings|params", re.IGNORECASE)  # names of folders that may hold the calibration
_SIDES = (("left", "cam0", "camera0"), ("right", "cam1", "camera1"))


def read_document(path: Path) -> Document:
    """Return the content of a file, with that of the files that it names: OpenVINS, VINS-Fusion. Raises ConfigError."""
    document = _read(path)
    named = {key: value for key, value in document.data.items() if _NAMES_A_FILE.fullmatch(str(key))}
    if not named or not all(isinstance(value, str) for value in named.values()):
        return document
    parts: dict[str, Any] = {key: _read(path.parent / value).data for key, value in named.items()}
    chains = [parts.pop(key) for key in list(parts) if key.startswith("relative")]  # as they would be alone
    together = {**document.data, **parts}
    for chain in chains:
        together |= chain
    return Document(document.name, together)


def _read(path: Path) -> Document:
    with as_error(ConfigError, f"cannot read calibration {path}", OSError):
        return load(read_small(path, LIMITS.small_bytes), path)


def documents_at(where: Where) -> list[Document]:
    """Return the content of the file or files of a calibration. Raises ConfigError."""
    if isinstance(where, list | tuple) and where and all(isinstance(path, str | Path) for path in where):
        return documents_at(where[0]) if len(where) == 1 else [read_document(Path(path)) for path in where]
    if not isinstance(where, str | Path):
        wanted = "give a file, the files of left and right, or their folder"
        raise ConfigError(f"the calibration is {described(where)}; {wanted}")
    path = Path(where)
    return _in_folder(path) if os.path.isdir(path) else [read_document(path)]


def pair_of(documents: Sequence[Document], size: Size | None) -> Pair:
    """Return left camera, right camera, `right_from_left` (4, 4) in metres, their known errors, and the IMU.

    `size` (width, height): of the images, for formats that do not contain it. Raises ConfigError naming file and key.
    """
    documents = _with_imu_file(documents)
    form = _format(documents)
    if form.files == 2 and len(documents) != 2:
        raise documents[0].error("this is the calibration of one camera: give both files, the left one first")
    if form.files == 1 and len(documents) != 1:
        raise documents[1].error("this is a second calibration of a pair: give one")
    left, right = documents if form.files == 2 else 2 * [_joined(documents)]
    return (
        form.camera(left, 0, size),
        form.camera(right, 1, size),
        form.pose(left, right, size),
        *form.known(left),
        form.imu(left),
    )


def _with_imu_file(documents: Sequence[Document]) -> Sequence[Document]:
    """Return the documents of cameras; the first also gets the content of an imu.yaml of Kalibr among them."""
    cameras = [document for document in documents if not is_imu_file(document.data)]
    units = [document for document in documents if is_imu_file(document.data)]
    if not cameras or not units:
        return documents
    first = cameras[0]
    return [Document(first.name, {**units[0].data, **first.data}, first.is_toml), *cameras[1:]]


def left_of(documents: Sequence[Document], size: Size | None) -> Camera:
    """Return the left camera alone; there need not be another. Raises as `pair_of`."""
    documents = _with_imu_file(documents)
    form = _format(documents)
    return form.camera(documents[0] if form.files else _joined(documents), 0, size)


def is_calibration(path: Path) -> bool:
    """Whether a file is a calibration in one of the formats."""
    try:
        return _format_of(read_document(path)) is not None
    except ConfigError:
        return False


def _joined(documents: Sequence[Document]) -> Document:
    if len(documents) == 1:
        return documents[0]
    data = {key: value for document in documents for key, value in document.data.items()}
    return Document(" and ".join(document.name for document in documents), data)


def has_calibration(folder: Path) -> bool:
    """Whether a folder itself holds a calibration."""
    return any(map(is_calibration, _candidates(folder)))


def _candidates(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file())


def _in_folder(folder: Path) -> list[Document]:
    """Return the calibration in a folder: one file, or the files of left and right. Raises ConfigError."""
    found = _all_in(folder)
    if not found:
        raise ConfigError(f"{folder} holds no calibration; known are {_known()}")
    if len(found) == 1:
        return found[0]
    listed = ", ".join(Path(d.name).name for documents in found for d in documents if not is_imu_file(d.data))
    raise ConfigError(f"{folder} holds several calibrations ({listed}): give one of them, or left and right")


def _all_in(folder: Path) -> list[list[Document]]:
    """Return the calibrations in a folder, each of one file or those of left and right, and with an inertial unit's."""
    readable: list[Document] = []
    for path in _candidates(folder) + [folder / name for name in _IN_FOLDERS if (folder / name).is_file()]:
        with suppress(ConfigError):
            readable.append(read_document(path))
    found: list[list[Document]] = []
    for form in FORMATS:
        if documents := [document for document in readable if _format_of(document) is form]:
            of_one = form is OPENCV or (form.files == 2 and len(documents) == 2)
            found += [sorted(documents, key=_is_right)] if of_one else [[document] for document in documents]
    units = [document for document in readable if is_imu_file(document.data) and _format_of(document) is None]
    return [documents + units[:1] for documents in found]


def calibrations_near(recording: Path) -> Iterator[list[list[Path]]]:
    """Yield the calibrations beside a recording, each the paths of its files; then those beside its folder, and so on.

    Folders beside it whose names say so count as well, such as `calibration`.
    """
    home = recording.absolute() if recording.is_dir() else recording.absolute().parent
    for place in [home, *home.parents][: SETTINGS.levels]:
        found: list[list[Path]] = []
        with suppress(OSError):
            inside = [path for path in sorted(place.iterdir()) if _NEAR.match(path.name) and path.is_dir()]
            for folder in [place, *inside]:
                if len(_candidates(folder)) <= SETTINGS.most_near:
                    found += [[Path(document.name) for document in documents] for documents in _all_in(folder)]
        yield found


def _is_right(document: Document) -> bool:
    """Whether a file of a pair is the right one, by the end of its path."""
    end = "/".join(Path(document.name).parts[-2:]).lower()
    left, right = (max(end.rfind(word) for word in words) for words in _SIDES)
    return right > left


def _format(documents: Sequence[Document]) -> Format:
    forms: list[Format] = []
    for document in documents:
        if (found := _format_of(document)) is None:
            raise document.error(f"its keys are of no known format; known are {_known()}")
        forms.append(found)
        if found is not forms[0]:
            raise document.error(f"this is a {found.name}, {documents[0].name} is a {forms[0].name}")
    return forms[0]


def _format_of(document: Document) -> Format | None:
    return TOML if document.is_toml else next((f for f in FORMATS[1:] if f.matches(document.data)), None)


def _known() -> str:
    return ", ".join(form.name for form in FORMATS)
