"""Calibrations of SLAM systems, with named lenses and poses in a body: Kalibr, EuRoC, Basalt, ORB-SLAM, VINS-Fusion."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...geometry import Array, se3
from ..models import Camera
from . import inertial
from .document import Document, Format, Size, camera_matrix
from .lenses import MODELS, nearest_fisheye

# Names of lenses -> those of a Camera, and the coefficients in order.
_BASALT: dict[str, tuple[str, tuple[str, ...]]] = {
    "pinhole": ("none", ()),
    "kb4": ("equidistant", ("k1", "k2", "k3", "k4")),
    "pinhole-radtan8": ("rational_polynomial", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
}
_ORB_SLAM: dict[str, tuple[str, tuple[str, ...]]] = {
    "PinHole": ("plumb_bob", ("k1", "k2", "p1", "p2", "k3")),
    "KannalaBrandt8": ("equidistant", ("k1", "k2", "k3", "k4")),
    "Rectified": ("none", ()),
}
# camodocal's: the names of focal lengths and centre come before those of the coefficients
_VINS: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "PINHOLE": ("plumb_bob", ("fx", "fy", "cx", "cy"), ("k1", "k2", "p1", "p2")),
    "KANNALA_BRANDT": ("equidistant", ("mu", "mv", "u0", "v0"), ("k2", "k3", "k4", "k5")),
    "MEI": ("omni", ("gamma1", "gamma2", "u0", "v0"), ("k1", "k2", "p1", "p2")),
}
_VINS_TABLES = ("projection_parameters", "distortion_parameters", "mirror_parameters")


def body_from_left(document: Document) -> Array | None:
    """Return the pose (4, 4) of the left camera in the body, if a calibration contains it. Raises ConfigError."""
    if EUROC.matches(document.data):
        return document.pose(document.data["T_BS"], "T_BS")
    if BASALT.matches(document.data):
        return _imu_from_cam(document, 0)
    cam0 = document.data.get("cam0")
    pose = inertial.cam_from_imu_of(document, cam0, "cam0") if isinstance(cam0, Mapping) else None
    return None if pose is None else se3.inverse(pose)


def _cam(document: Document, name: str) -> Mapping[str, Any]:
    if not isinstance(table := document.data.get(name), Mapping):
        raise document.error(f"{name} is missing: a pair needs two cameras")
    return table


def _kalibr_pose(document: Document, _: Document, _size: Size | None) -> Array:
    second = _cam(document, "cam1")
    if "T_cn_cnm1" in second:
        return document.pose(second["T_cn_cnm1"], "cam1.T_cn_cnm1")
    poses = [inertial.cam_from_imu_of(document, _cam(document, cam), cam) for cam in ("cam0", "cam1")]
    if poses[0] is not None and poses[1] is not None:
        return poses[1] @ se3.inverse(poses[0])
    raise document.error("cam1.T_cn_cnm1, the pose of cam0 in cam1, is missing: calibrate both cameras together")


def _lens(document: Document, table: Mapping[str, Any], where: str, coefficients: str, default: str) -> Camera:
    """Return a camera as Kalibr and EuRoC write it, with the distortion `default` if none is named.

    `where` precedes each key in errors; `coefficients`: the key of the distortion coefficients.
    """
    model, lens = str(table.get("camera_model", "pinhole")), table.get("distortion_model")
    if model != "pinhole" and model not in MODELS:
        known = f"only pinhole and {', '.join(MODELS)}: calibrate with pinhole-radtan or pinhole-equi"
        raise document.error(f"{where}camera_model {model!r} is not supported, {known}")
    names = MODELS[model][0] if model in MODELS else ()
    numbers = document.numbers(table.get("intrinsics"), f"{where}intrinsics", (len(names) + 4,))
    size = document.size(table.get("resolution"), f"{where}resolution")
    d = document.numbers(table.get(coefficients) or [], f"{where}{coefficients}", None)
    k = camera_matrix(*numbers[len(names) :])
    if not names:
        return document.camera(size, k, default if lens is None else lens, d.tolist())
    if lens not in (None, "none") and not (model == "omni" and lens == "radtan"):
        raise document.error(f"{where}distortion_model {lens!r} of a {model} camera is not supported, only none")
    return nearest_fisheye(document, where, model, size, k, dict(zip(names, numbers.tolist(), strict=False)), d)


def _basalt(data: Mapping[str, Any]) -> Any:
    return data.get("value0", data)


def _basalt_camera(document: Document, side: int, size: Size | None) -> Camera:
    entry, where = _basalt_entry(document, "intrinsics", side), f"intrinsics[{side}]."
    model, values = str(_in(entry, "camera_type")), _in(entry, "intrinsics")
    if model not in {**_BASALT, **MODELS}:
        known = ", ".join([*_BASALT, *MODELS])
        raise document.error(f"{where}camera_type {model!r} is not supported; supported are {known}")
    size = document.size(_basalt_entry(document, "resolution", side), f"resolution[{side}]")
    names = ("fx", "fy", "cx", "cy", *(MODELS[model][0] if model in MODELS else _BASALT[model][1]))
    numbers = {name: document.number(_in(values, name), f"{where}{name}") for name in names}
    k = camera_matrix(*(numbers.pop(name) for name in names[:4]))
    if model in MODELS:
        return nearest_fisheye(document, where, model, size, k, numbers, np.zeros(0))
    return document.camera(size, k, _BASALT[model][0], list(numbers.values()))


def _basalt_entry(document: Document, key: str, n: int) -> Any:
    entries = _basalt(document.data)[key]
    if not isinstance(entries, list) or len(entries) <= n:
        raise document.error(f"{key}[{n}] is missing: a pair needs two cameras")
    return entries[n]


def _imu_from_cam(document: Document, n: int) -> Array:
    entry = _basalt_entry(document, "T_imu_cam", n)
    names = ("px", "py", "pz", "qx", "qy", "qz", "qw")
    numbers = document.numbers([_in(entry, name) for name in names], f"T_imu_cam[{n}]", (7,))
    return se3.from_rotation_translation(se3.matrix_from_quat_xyzw(numbers[3:]), numbers[:3])


def _in(table: Any, key: str) -> Any:
    return table.get(key) if isinstance(table, Mapping) else None


def _orb_slam_camera(document: Document, side: int, size: Size | None) -> Camera:
    """Read one camera; a rectified pair gives one camera without distortion, used for both."""
    data, model = document.data, str(document.data.get("Camera.type", "PinHole"))
    if "Camera.width" in data and "Camera.height" in data:
        size = document.size([data["Camera.width"], data["Camera.height"]], "Camera.width and Camera.height")
    if size is None:
        raise document.error("Camera.width and Camera.height are missing", "size")
    if model not in _ORB_SLAM:
        raise document.error(f"Camera.type {model!r} is not supported; supported are {', '.join(_ORB_SLAM)}")
    name = _orb_slam_name(data, side)
    k = camera_matrix(*(document.number(data.get(f"{name}.{x}"), f"{name}.{x}") for x in ("fx", "fy", "cx", "cy")))
    rectified = "Stereo.T_c1_c2" not in data and ("Stereo.b" in data or "Camera.bf" in data)
    lens, names = _ORB_SLAM["Rectified" if rectified else model]
    d = [document.number(data.get(key, 0.0), key) for key in (f"{name}.{x}" for x in names)]
    return document.camera(size, k, lens, d)


def _orb_slam_name(data: Mapping[str, Any], side: int) -> str:
    return f"Camera{side + 1 if 'Stereo.T_c1_c2' in data else 1}" if "Camera1.fx" in data else "Camera"


def _orb_slam_pose(document: Document, _: Document, _size: Size | None) -> Array:
    """Return the pose from T_c1_c2, which carries points of the right camera into the left, or from the baseline."""
    data = document.data
    if "Stereo.T_c1_c2" in data:
        return se3.inverse(document.pose(data["Stereo.T_c1_c2"], "Stereo.T_c1_c2"))
    if "Stereo.b" in data:
        baseline_m = document.number(data["Stereo.b"], "Stereo.b")
    elif "Camera.bf" in data:
        fx = f"{_orb_slam_name(data, 0)}.fx"
        baseline_m = document.number(data["Camera.bf"], "Camera.bf") / document.number(data.get(fx), fx)
    else:
        raise document.error("Stereo.T_c1_c2 (or Stereo.b, Camera.bf), the pose of the right camera, is missing")
    return se3.exp([-baseline_m, 0, 0, 0, 0, 0])


def _vins_camera(document: Document, side: int, _size: Size | None) -> Camera:
    """Read one camera of camodocal; all but the matrix may be in either table of its file."""
    where = f"cam{side}_calib"
    if not isinstance(file := document.data.get(where), Mapping):
        raise document.error(f"{where} is missing: a pair needs two cameras")
    model = str(file.get("model_type"))
    if model not in _VINS:
        raise document.error(f"{where}: model_type {model!r} is not supported; supported are {', '.join(_VINS)}")
    lens, of_matrix, of_lens = _VINS[model]
    values = {k: v for name in _VINS_TABLES if isinstance(t := file.get(name), Mapping) for k, v in t.items()}
    size = document.size([file.get("image_width"), file.get("image_height")], f"{where}: image_width, image_height")
    k = camera_matrix(*(document.number(values.get(x), f"{where}: {x}") for x in of_matrix))
    d = [document.number(values.get(x, 0.0), f"{where}: {x}") for x in of_lens]
    if lens in MODELS:
        xi = document.number(values.get("xi"), f"{where}: xi")
        return nearest_fisheye(document, f"{where}: ", lens, size, k, {"xi": xi}, np.array(d))
    return document.camera(size, k, lens, d)


def _vins_body_from_cam(document: Document, n: int) -> Array:
    return document.pose(document.data.get(f"body_T_cam{n}"), f"body_T_cam{n}")


def _is_basalt(data: Mapping[str, Any]) -> bool:
    inside = _basalt(data)
    return isinstance(inside, Mapping) and {"T_imu_cam", "intrinsics", "resolution"} <= set(inside)


def _is_orb_slam(data: Mapping[str, Any]) -> bool:
    return "Camera1.fx" in data or ("Camera.fx" in data and "Camera.bf" in data)


KALIBR = Format(
    "Kalibr or OpenVINS camchain (YAML)",
    1,
    lambda data: isinstance(data.get("cam0"), Mapping) and "intrinsics" in data["cam0"],
    lambda calib, n, _: _lens(calib, _cam(calib, f"cam{n}"), f"cam{n}.", "distortion_coeffs", "none"),
    _kalibr_pose,
    imu=inertial.of_kalibr,
)
EUROC = Format(
    "EuRoC sensor.yaml",
    2,
    lambda data: "T_BS" in data and "intrinsics" in data,
    lambda calib, _, size: _lens(calib, calib.data, "", "distortion_coefficients", "plumb_bob"),
    lambda left, right, _: se3.inverse(right.pose(right.data["T_BS"], "T_BS")) @ left.pose(left.data["T_BS"], "T_BS"),
    imu=inertial.of_euroc,
)
BASALT = Format(
    "Basalt calibration (JSON)",
    1,
    _is_basalt,
    _basalt_camera,
    lambda calib, _, _size: se3.inverse(_imu_from_cam(calib, 1)) @ _imu_from_cam(calib, 0),
    imu=lambda calib: inertial.of_basalt(calib, _imu_from_cam(calib, 0), _basalt(calib.data)),
)
ORB_SLAM = Format(
    "ORB-SLAM settings (YAML)", 1, _is_orb_slam, _orb_slam_camera, _orb_slam_pose, imu=inertial.of_orb_slam
)
VINS = Format(
    "VINS-Fusion configuration (YAML)",
    1,
    lambda data: isinstance(data.get("cam0_calib"), Mapping) and "body_T_cam0" in data,
    _vins_camera,
    lambda calib, _, _size: se3.inverse(_vins_body_from_cam(calib, 1)) @ _vins_body_from_cam(calib, 0),
    imu=lambda calib: inertial.of_vins(calib, _vins_body_from_cam(calib, 0)),
)
