"""EuRoC (and what is laid out like it): mav0 with cam0, cam1 and state_groundtruth_estimate0.

`T_BS` in each sensor.yaml is the sensor in the body: body_from_cam. Ground truth is the body in the world, with the
quaternion's scalar first; it is brought into the left camera here.
"""

import re
from pathlib import Path

import numpy as np

from ..camera.models import Camera
from ..errors import ConfigError, InputError
from ..geometry import se3
from ..geometry.se3 import Array
from .common import ImageFile, Imported, ascending, read_text, rig_of_files, write_images

_MODELS = {"radial-tangential": "plumb_bob", "radtan": "plumb_bob", "equidistant": "equidistant", "none": "none"}
_TRUTH = "state_groundtruth_estimate0"


def import_euroc(folder: str | Path, out: str | Path) -> Imported:
    """The recording in `folder` (mav0, or the folder that holds it) as a log at `out`.

    Raises InputError, ConfigError, OutputError.
    """
    folder = Path(folder)
    mav = folder / "mav0" if (folder / "mav0").is_dir() else folder
    if not (mav / "cam0").is_dir() or not (mav / "cam1").is_dir():
        raise InputError(f"{folder} holds no mav0 with cam0 and cam1: give the folder of one EuRoC recording")
    left, body_from_left = _sensor(mav / "cam0" / "sensor.yaml")
    right, body_from_right = _sensor(mav / "cam1" / "sensor.yaml")
    right_from_left = se3.inverse(body_from_right) @ body_from_left
    rig = rig_of_files(mav / "cam1" / "sensor.yaml", left, right, right_from_left)
    images = (_images(mav / "cam0"), _images(mav / "cam1"))
    warnings = []
    truth: list[tuple[int, Array]] = []
    if (mav / _TRUTH / "data.csv").is_file():
        truth = _truth(mav / _TRUTH / "data.csv", body_from_left)
    else:
        warnings.append(f"no ground truth: {mav / _TRUTH / 'data.csv'} is missing")
    return write_images(out, rig, images, truth, warnings)


def _sensor(path: Path) -> tuple[Camera, Array]:
    """The camera and body_from_cam (4, 4) of a sensor.yaml.

    The file is read by its keys, each a word or a list in brackets: no YAML library is asked for.
    """
    text = re.sub(r"#.*", "", read_text(path, "calibration"))

    def numbers(key: str, count: int | None, after: str = "") -> Array:
        found = re.search(rf"{after}^\s*{key}\s*:\s*\[([^\]]*)\]", text, re.MULTILINE | re.DOTALL)
        try:
            values = np.array([float(x) for x in found[1].split(",") if x.strip()]) if found else np.empty(0)
        except ValueError:
            values = np.empty(0)
        if not found or (count is not None and len(values) != count) or not np.isfinite(values).all():
            wanted = f"{count} numbers" if count is not None else "numbers"
            raise ConfigError(f"{path}: {after and 'T_BS.'}{key} must be a list of {wanted} in brackets")
        return values

    model = re.search(r"^\s*distortion_model\s*:\s*[\"']?([\w-]+)", text, re.MULTILINE)
    name = model[1] if model else "none"
    if name not in _MODELS:
        raise ConfigError(f"{path}: distortion model {name!r} is not known; known are {', '.join(_MODELS)}")
    width, height = (int(x) for x in numbers("resolution", 2))
    fx, fy, cx, cy = numbers("intrinsics", 4)
    coefficients = numbers("distortion_coefficients", None) if name != "none" else np.empty(0)
    body_from_cam = numbers("data", 16, after=r"^\s*T_BS\s*:.*?").reshape(4, 4)
    rotation = body_from_cam[:3, :3]
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) or np.linalg.det(rotation) < 0:
        raise ConfigError(f"{path}: T_BS holds no rotation: {rotation.tolist()}")
    try:
        k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        camera = Camera(width, height, k, tuple(coefficients), _MODELS[name])
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    return camera, se3.orthonormalise(body_from_cam)


def _rows(path: Path) -> list[list[str]]:
    lines = (line.strip() for line in read_text(path, "table").splitlines())
    return [[cell.strip() for cell in line.split(",")] for line in lines if line and not line.startswith("#")]


def _stamp(path: Path, number: int, cell: str) -> int:
    if not cell.isdecimal():
        raise InputError(f"{path}: row {number} starts with {cell!r}, not with a stamp in nanoseconds")
    return int(cell)


def _images(folder: Path) -> list[ImageFile]:
    path = folder / "data.csv"
    rows = _rows(path)
    if not rows or any(len(r) < 2 for r in rows):
        raise InputError(f"{path} must list stamps and file names, one image a row")
    stamps = [_stamp(path, n, r[0]) for n, r in enumerate(rows, start=1)]
    ascending(stamps, path)
    return [ImageFile(s, folder / "data" / r[1]) for s, r in zip(stamps, rows, strict=True)]


def _truth(path: Path, body_from_left: Array) -> list[tuple[int, Array]]:
    rows = _rows(path)
    stamps = [_stamp(path, n, r[0]) for n, r in enumerate(rows, start=1)]
    ascending(stamps, path)
    try:
        values = np.array([[float(x) for x in r[1:8]] for r in rows]).reshape(-1, 7)
    except ValueError:
        raise InputError(f"{path}: a row must hold a stamp, a position and a quaternion (w, x, y, z)") from None
    if not len(values):
        raise InputError(f"{path} holds no pose")
    norms = np.linalg.norm(values[:, 3:], axis=1)
    if not np.isfinite(values).all() or not ((norms > 0.9) & (norms < 1.1)).all():
        raise InputError(f"{path}: a quaternion (columns 5 to 8, w x y z) is not of length 1")
    rotations = se3.matrix_from_quat_xyzw(values[:, [4, 5, 6, 3]])
    world_from_body = se3.from_rotation_translation(rotations, values[:, :3])
    return list(zip(stamps, world_from_body @ body_from_left, strict=True))
