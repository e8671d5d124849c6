"""A calibration file as nested dictionaries, whatever it is written in: TOML, YAML, INI, OpenCV's FileStorage, rows."""

import re
import reprlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ...errors import ConfigError, as_error
from ...geometry import Array, se3
from ...inertial.samples import ImuCalibration
from ...record import record
from ...system.inputs import LIMITS, check_text, check_values, parse_toml
from ..models import DISTORTION_COEFFICIENTS, DISTORTION_MODELS, Camera
from ..refinement import KnownTiming, Refinement

# left, right, right_from_left (4, 4) in metres, what is known about their errors, and an inertial unit
Pair = tuple[Camera, Camera, Array, Refinement | None, KnownTiming | None, ImuCalibration | None]
Size = tuple[int, int]  # width, height in pixels
Where: TypeAlias = str | Path | Sequence[str | Path]  # a file, the files of left and right, or a folder

_TOML_SECTION = re.compile(rb"^[ \t]*\[(left|right|right_from_left)\b", re.MULTILINE)
_YAML_OF_OPENCV = re.compile(r"\s*%YAML:[\d.]+[ \t]*(#[^\r\n]*)?(?=[\r\n])")
# KITTI: a name and at least two numbers; one such line has more, which no YAML has.
_ROW = re.compile(r"^(\w+):((?:[ \t]+[-+\d.eE]+){2,})[ \t\r]*$", re.MULTILINE)
_SECTION = re.compile(rb"^[ \t]*\[(LEFT_CAM_\w+|\w+_LEFT2RIGHT_POSE)\]", re.MULTILINE)  # of a ZED, of MRPT


@record
class Document:
    """The content of one file; `name` is its path, for messages."""

    name: str
    data: Mapping[str, Any]
    is_toml: bool = False

    def error(self, problem: str, *hints: str) -> ConfigError:
        """Return an error that names the file."""
        return ConfigError(f"calibration {self.name}: {problem}", hint=hints)

    def naming(self, *section: str) -> AbstractContextManager[None]:
        """Within the context a ConfigError becomes one that names the file, and a section of it."""
        return as_error(ConfigError, ": ".join((f"calibration {self.name}", *section)), ConfigError)

    def numbers(self, value: Any, key: str, shape: tuple[int, ...] | None) -> Array:
        """`value`, called `key` in errors, as finite numbers of a shape (None: a list of any length).

        Matrices may be flat, in rows, or a mapping with `data`; strings and booleans are not numbers in TOML.
        """
        if isinstance(value, Mapping) and "data" in value:
            value = value["data"]
        try:
            array = np.array(value)
            typed = array.dtype.kind in "iuf" or not array.size or (not self.is_toml and array.dtype.kind == "U")
            array = array.astype(float) if typed else np.array(None)
        except (TypeError, ValueError):  # rows of different length, words
            array = np.array(None)
        if array.dtype == float and shape is not None and array.size == int(np.prod(shape)):
            array = array.reshape(shape)
        fits = array.dtype == float and (array.ndim == 1 if shape is None else array.shape == shape)
        if not fits or not np.isfinite(array).all():
            wanted = f"{'×'.join(map(str, shape))} numbers" if shape else "a number"
            wanted = "a list of numbers" if shape is None else wanted
            raise self.error(f"{key} must be {wanted}, finite, got {short(value)}")
        return array

    def rotation(self, value: Any, key: str) -> Array:
        """`value` as a rotation matrix (3, 3)."""
        matrix = self.numbers(value, key, (3, 3))
        if not se3.is_rotation(matrix):
            raise self.error(f"{key} is not a rotation matrix: {matrix.tolist()}")
        return matrix

    def pose(self, value: Any, key: str) -> Array:
        """`value` as a pose (4, 4): rotation and translation in metres."""
        pose = self.numbers(value, key, (4, 4))
        self.rotation(pose[:3, :3], key)
        return se3.orthonormalise(pose)

    def camera(self, size: Size, k: Array, model: Any, coefficients: Sequence[float]) -> Camera:
        """A camera; `model` has any of the names in use, `coefficients` may be padded or cut short with zeros."""
        with self.naming():
            return make_camera(size, k, "" if model is None else str(model), coefficients)

    def number(self, value: Any, key: str) -> float:
        """`value` as a finite number."""
        return float(self.numbers(value, key, ()))

    def size(self, value: Any, key: str) -> Size:
        """`value` as a width and a height in pixels."""
        width, height = self.numbers(value, key, (2,))
        return int(width), int(height)


class Format(NamedTuple):
    """A format of calibration files. `files`: how many a pair needs, 0 for one or two that are read as one.

    `camera`: the camera of a side (0 left, 1 right), by the size of its images where the format does not tell it.
    `pose`: `right_from_left` (4, 4) in metres, by the files of left and right, which may be one. `known`: what is known
    about their errors. `imu`: an inertial unit, if the left file has one. They raise ConfigError.
    """

    name: str
    files: int
    matches: Callable[[Mapping[str, Any]], bool]
    camera: Callable[[Document, int, Size | None], Camera]
    pose: Callable[[Document, Document, Size | None], Array]
    known: Callable[[Document], tuple[Refinement | None, KnownTiming | None]] = lambda _: (None, None)
    imu: Callable[[Document], ImuCalibration | None] = lambda _: None


def camera_matrix(fx: float, fy: float, cx: float, cy: float) -> Array:
    """K (3, 3), pixels."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def make_camera(size: Size, k: Array, model: str, coefficients: Sequence[float]) -> Camera:
    """A camera with its distortion as other tools write it. Raises ConfigError for models that are not supported."""
    known = DISTORTION_MODELS.get(model.strip().lower() or "plumb_bob")
    if known is None and any(coefficients):
        supported = ", ".join(DISTORTION_MODELS)
        raise ConfigError(f"distortion model {model!r} is not supported; supported are {supported}")
    if known == "none" and any(coefficients):
        problem = f"distortion model {model!r} comes with the coefficients {[float(c) for c in coefficients]}"
        raise ConfigError(f"{problem}: name the model that they are of, such as plumb_bob, or leave them out")
    if known == "plumb_bob" and any(coefficients[5:]):
        known = "rational_polynomial"  # some tools write eight coefficients under the older name
    # A fisheye lens whose coefficients are all zero is still a fisheye.
    if known is None or known == "none" or (known != "equidistant" and not any(coefficients)):
        return Camera(*size, k, (), "none")
    return Camera(*size, k, _fit_coefficients(known, tuple(coefficients)), known)


def _fit_coefficients(model: str, given: tuple[float, ...]) -> tuple[float, ...]:
    """As many coefficients as the model takes: tools leave out zeros, or append them."""
    counts = DISTORTION_COEFFICIENTS[model]
    if len(given) in counts:
        return given
    count = next((n for n in counts if n > 0 and not any(given[n:])), None)
    if count is None:
        most = f"only the first {max(counts)} of {model} (no thin prism, no tilt)"
        raise ConfigError(f"{len(given)} distortion coefficients are not supported, {most}: rectify the images")
    return (*given, *[0.0] * count)[:count]


def load(content: bytes, name: str | Path) -> Document:
    """Return the document in the content of a file. Raises ConfigError if it is in no language that is known."""
    name = str(name)
    if len(content) > LIMITS.small_bytes:
        raise ConfigError(f"calibration {name} has {len(content) / 1e6:.1f} MB: it is not a calibration file")
    if name.lower().endswith(".toml") or _TOML_SECTION.search(content):
        return Document(name, _load_toml(content, name), is_toml=True)
    if _SECTION.search(content):
        return Document(name, _load_ini(content, name))
    if content.startswith(b"PK"):
        return Document(name, _load_npz(content, name))
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(f"calibration {name} is not a text file") from None
    of_opencv = _YAML_OF_OPENCV.match(text)
    if of_opencv and "opencv-matrix" not in text:  # its head on a file that its parser need not take
        with suppress(ConfigError):
            return Document(name, _load_yaml(text[of_opencv.end() :], name))
    if of_opencv or "opencv-matrix" in text or "<opencv_storage" in text:
        return Document(name, _load_opencv(text, name))
    rows = dict(_ROW.findall(text))
    if any(len(row.split()) > 2 for row in rows.values()):
        return Document(name, {key: row.split() for key, row in rows.items()})
    return Document(name, _load_yaml(text, name))


def _load_toml(content: bytes, name: str) -> dict[str, Any]:
    with as_error(ConfigError, f"calibration {name} is not TOML", ValueError, RecursionError):
        if len(content) > LIMITS.settings_bytes:
            raise ValueError(f"it has {len(content)} bytes")
        return parse_toml(content.decode("utf-8-sig"))


def _load_ini(content: bytes, name: str) -> dict[str, Any]:
    import configparser

    try:
        parser = configparser.ConfigParser(interpolation=None, strict=False)
        parser.read_string(content.decode("utf-8-sig"))
    except (configparser.Error, UnicodeDecodeError) as error:
        problem = " ".join(f"{error}".split())
        raise ConfigError(f"calibration {name} is not a file of sections with keys: {problem}") from None
    return {section: dict(parser[section]) for section in parser.sections()}


def _load_npz(content: bytes, name: str) -> dict[str, Any]:
    """Arrays that np.savez has written; nothing in them is executed."""
    import zipfile
    import zlib

    caught = ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError
    with as_error(ConfigError, f"calibration {name} is not a file of np.savez with arrays of numbers", *caught):
        with zipfile.ZipFile(BytesIO(content)) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > LIMITS.small_bytes:
                raise ValueError("it holds large arrays")
        with np.load(BytesIO(content), allow_pickle=False) as arrays:
            found = {key: arrays[key] for key in arrays.files}
        if other := [key for key, value in found.items() if not isinstance(value, np.ndarray)]:
            raise ValueError(f"{short(other[0])} in it is not an array")
        return {key: value.tolist() for key, value in found.items()}


def _load_yaml(text: str, name: str) -> dict[str, Any]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        if len(text) > LIMITS.settings_bytes:
            raise ValueError(f"it has {len(text)} characters")
        check_text(text)
        data = YAML(typ="safe", pure=True).load(text)
        check_values(data)
    except (YAMLError, ValueError, RecursionError) as error:
        problem = " ".join(f"{error}".split())
        raise ConfigError(f"calibration {name} is neither TOML nor YAML: {problem}") from None
    if not isinstance(data, dict):
        raise ConfigError(f"calibration {name} has no keys: it is not a calibration file")
    return data


def _load_opencv(text: str, name: str) -> dict[str, Any]:
    import cv2

    with as_error(ConfigError, f"calibration {name} is not a file of OpenCV's FileStorage", ValueError):
        check_text(text)  # OpenCV's parsers recurse without a limit
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        try:
            root = storage.root()
            return {key: _node(root.getNode(key)) for key in _keys(root)}
        finally:
            storage.release()
    except (cv2.error, SystemError) as error:  # the latter with the former as its cause, where no storage was made
        cause = error if isinstance(error, cv2.error) else error.__cause__
        problem = cause.err if isinstance(cause, cv2.error) else "it is damaged"
        raise ConfigError(f"calibration {name} is not a file of OpenCV's FileStorage: {problem}") from None


def _node(node: Any) -> Any:
    """Return a value of OpenCV's FileStorage."""
    if node.isMap():
        matrix = node.mat() if "data" in _keys(node) else None
        return matrix if matrix is not None else {key: _node(node.getNode(key)) for key in _keys(node)}
    if node.isSeq():
        return [_node(node.at(n)) for n in range(node.size())]
    return node.string() if node.isString() else node.real()


def _keys(node: Any) -> list[str]:
    return list(node.keys())  # a node has keys but is not a dictionary


def short(value: object, most: int = 80) -> str:
    """Return a value in one line of at most so many characters, for messages."""
    text = " ".join(reprlib.repr(value).split())
    return text if len(text) <= most else f"{text[: most - 1]}…"


def named(where: Where) -> str:
    """Return the path or paths as text, for messages."""
    return str(where) if isinstance(where, str | Path) else " and ".join(map(str, where))
