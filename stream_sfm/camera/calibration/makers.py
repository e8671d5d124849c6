"""Calibrations of stereo cameras by their makers, the JSON of an OAK and the conf of a ZED, and by MRPT (Malaga)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...geometry import Array, se3
from ..models import Camera
from .document import Document, Format, Size, camera_matrix

_OAK_FISHEYE = 1  # cameraType
_OAK_LINKS = 8  # more than any board has cameras
# Names of ZED's resolutions, by the size of one image
_ZED_SIZES = {
    (2208, 1242): "2K", (1920, 1080): "FHD", (1920, 1200): "FHD1200", (1280, 720): "HD", (960, 600): "SVGA",
    (672, 376): "VGA",
}  # fmt: skip
_MRPT_POSE = "_LEFT2RIGHT_POSE"
_ZED_LENS = ("k1", "k2", "p1", "p2", "k3")


def _oak_socket(document: Document, side: int) -> int:
    """Return the socket of a camera: left 1 and right 2, unless the file says otherwise."""
    stereo, key = document.data.get("stereoRectificationData"), ("leftCameraSocket", "rightCameraSocket")[side]
    socket = stereo.get(key, -1) if isinstance(stereo, Mapping) else -1
    return socket if isinstance(socket, int) and socket >= 0 else 1 + side


def _oak_entry(document: Document, socket: int) -> Mapping[str, Any]:
    for entry in document.data["cameraData"]:
        if isinstance(entry, list) and len(entry) == 2 and entry[0] == socket and isinstance(entry[1], Mapping):
            return entry[1]
    raise document.error(f"cameraData has no camera of socket {socket}")


def _oak_camera(document: Document, side: int, size: Size | None) -> Camera:
    """Return a camera scaled to the size of the images, which is often half that of the calibration."""
    socket = _oak_socket(document, side)
    entry, where = _oak_entry(document, socket), f"cameraData[{socket}]."
    own = document.size([entry.get("width"), entry.get("height")], f"{where}width and height")
    k = document.numbers(entry.get("intrinsicMatrix"), f"{where}intrinsicMatrix", (3, 3))
    d = document.numbers(entry.get("distortionCoeff") or [], f"{where}distortionCoeff", None).tolist()
    width, height = size = size or own
    if width * own[1] != height * own[0]:
        problem = f"{where} is for {own[0]}×{own[1]}, of which {width}×{height} is no scaled image"
        raise document.error(f"{problem}: give a calibration of the images, which are cropped")
    scale = width / own[0]
    # pixel (0, 0) is the centre of the first one
    k = np.array([[scale, 0, (scale - 1) / 2], [0, scale, (scale - 1) / 2], [0, 0, 1]]) @ k
    if entry.get("cameraType") == _OAK_FISHEYE:
        return document.camera(size, k, "equidistant", d[:4])
    return document.camera(size, k, "rational_polynomial", d)


def _oak_pose(document: Document, _: Document, _size: Size | None) -> Array:
    """Return the pose from the links between sockets, which carry points of one camera into the next, in cm."""
    left, right = (_oak_to_root(document, _oak_socket(document, side)) for side in (0, 1))
    common = next((socket for socket in left if socket in right), None)
    if common is None:
        raise document.error("no extrinsics lead from the left camera to the right one")
    return se3.inverse(right[common]) @ left[common]


def _oak_to_root(document: Document, socket: int) -> dict[int, Array]:
    """Return socket -> its pose, `socket_from_camera` (4, 4) in metres, along the links from a camera."""
    found, pose = {socket: np.eye(4)}, np.eye(4)
    for _ in range(_OAK_LINKS):
        link = _oak_entry(document, socket).get("extrinsics")
        following = link.get("toCameraSocket", -1) if isinstance(link, Mapping) else -1
        if not isinstance(link, Mapping) or not isinstance(following, int) or following < 0 or following in found:
            break
        where = f"cameraData[{socket}].extrinsics"
        t = link.get("translation")
        translation = [t.get(axis) if isinstance(t, Mapping) else None for axis in "xyz"]
        rotation = document.rotation(link.get("rotationMatrix"), f"{where}.rotationMatrix")
        t_cm = document.numbers(translation, f"{where}.translation", (3,))
        pose = se3.orthonormalise(se3.from_rotation_translation(rotation, t_cm / 100)) @ pose
        socket, found[following] = following, pose
    return found


def _zed_name(document: Document, size: Size | None) -> str:
    if size is None:
        raise document.error("the file is for several sizes of images: use it with a recording", "size")
    if (name := _ZED_SIZES.get(size)) is None:
        known = ", ".join(f"{width}×{height}" for width, height in _ZED_SIZES)
        raise document.error(f"images of {size[0]}×{size[1]} do not come from a ZED, which has {known}")
    return name


def _zed_camera(document: Document, side: int, size: Size | None) -> Camera:
    section = f"{('LEFT', 'RIGHT')[side]}_CAM_{_zed_name(document, size)}"
    k = camera_matrix(*_zed_numbers(document, section, ("fx", "fy", "cx", "cy")))
    assert size is not None  # `_zed_name` has checked it
    return document.camera(size, k, "plumb_bob", _zed_numbers(document, section, _ZED_LENS, missing=0.0))


def _zed_pose(document: Document, _: Document, size: Size | None) -> Array:
    """Return the pose: Baseline, TY and TZ are the position of the right camera, mm; RX, CV, RZ a rotation vector."""
    names = [f"{axis}_{_zed_name(document, size)}" for axis in ("RX", "CV", "RZ")]
    turn = _zed_numbers(document, "STEREO", names, missing=0.0)
    t_mm = _zed_numbers(document, "STEREO", ("Baseline", "TY", "TZ"), missing=0.0)
    return se3.from_rotation_translation(se3.exp_so3(turn), -np.array(t_mm) / 1000)


def _zed_numbers(document: Document, section: str, names: Sequence[str], missing: float | None = None) -> list[float]:
    table = document.data.get(section)
    if not isinstance(table, Mapping):
        raise document.error(f"[{section}] is missing")
    return [document.number(table.get(name.lower(), missing), f"{section}.{name}") for name in names]


def _mrpt_section(document: Document, end: str) -> tuple[str, Mapping[str, Any]]:
    """Return the section whose name ends so: what is in front is the user's."""
    for name, table in document.data.items():
        if str(name).endswith(end) and isinstance(table, Mapping):
            return name, table
    raise document.error(f"a section […{end}] is missing")


def _mrpt_list(document: Document, end: str, key: str, count: int) -> Array:
    name, table = _mrpt_section(document, end)
    return document.numbers(str(table.get(key, "")).strip("[] ").split(), f"{name}.{key}", (count,))


def _mrpt_camera(document: Document, side: int, _size: Size | None) -> Camera:
    end = ("_LEFT", "_RIGHT")[side]
    name, table = _mrpt_section(document, end)
    k = camera_matrix(*(document.number(table.get(key), f"{name}.{key}") for key in ("fx", "fy", "cx", "cy")))
    size = document.size(_mrpt_list(document, end, "resolution", 2), f"{name}.resolution")
    return document.camera(size, k, "plumb_bob", _mrpt_list(document, end, "dist", 5).tolist())


def _mrpt_pose(document: Document, _: Document, _size: Size | None) -> Array:
    """Return the pose; the file has that of the right camera in the left one, with the quaternion's w first."""
    x, y, z, *wxyz = _mrpt_list(document, _MRPT_POSE, "pose_quaternion", 7)
    rotation = se3.matrix_from_quat_xyzw(np.array([*wxyz[1:], wxyz[0]]))
    return se3.inverse(se3.from_rotation_translation(rotation, np.array([x, y, z])))


def _is_oak(data: Mapping[str, Any]) -> bool:
    return isinstance(data.get("cameraData"), list)


def _is_zed(data: Mapping[str, Any]) -> bool:
    return isinstance(data.get("STEREO"), Mapping) and any(str(key).startswith("LEFT_CAM_") for key in data)


def _is_mrpt(data: Mapping[str, Any]) -> bool:
    return any(str(key).endswith(_MRPT_POSE) for key in data)


OAK = Format("OAK calibration (JSON)", 1, _is_oak, _oak_camera, _oak_pose)
ZED = Format("ZED conf file", 1, _is_zed, _zed_camera, _zed_pose)
MRPT = Format("MRPT stereo camera (INI)", 1, _is_mrpt, _mrpt_camera, _mrpt_pose)
