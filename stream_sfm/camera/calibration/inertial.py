"""The inertial unit of a calibration: where it is mounted, its noise and its clock, as each format writes them."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from ...geometry import Array, se3
from ...inertial.samples import ImuCalibration
from .document import Document

KEYS = tuple(field.name for field in fields(ImuCalibration))
_DENSITIES = ("gyro_noise", "gyro_walk", "accel_noise", "accel_walk")  # and their names in other formats
# Kalibr's imu.yaml, also within `imu0`, and EuRoC's imu0/sensor.yaml.
_OF_SENSOR = ("noise_density", "random_walk")
_KALIBR = (*(f"gyroscope_{of}" for of in _OF_SENSOR), *(f"accelerometer_{of}" for of in _OF_SENSOR))
_BASALT = ("gyro_noise_std", "gyro_bias_std", "accel_noise_std", "accel_bias_std")
_ORB_SLAM = ("IMU.NoiseGyro", "IMU.GyroWalk", "IMU.NoiseAcc", "IMU.AccWalk")


def is_imu_file(data: Mapping[str, Any]) -> bool:
    """Whether a document is Kalibr's imu.yaml: it has the noise of a unit and no camera."""
    return any("accelerometer_noise_density" in table for table in (data, _table(data)))


def _table(data: Mapping[str, Any]) -> Mapping[str, Any]:
    inside = data.get("imu0")
    return inside if isinstance(inside, Mapping) else {}


def imu_of(document: Document, cam_from_imu: Array | None, noise: Mapping[str, float]) -> ImuCalibration | None:
    """Return the unit with its known numbers; None if its mounting is unknown. Raises ConfigError."""
    if cam_from_imu is None:
        return None
    with document.naming():
        return ImuCalibration(cam_from_imu, **noise)


def noise_of(document: Document, table: Mapping[str, Any], keys: Sequence[str]) -> dict[str, float]:
    """Return the densities under those of these keys that a table has; for one per axis, their root mean square."""
    found = {}
    for key, name in zip(keys, _DENSITIES, strict=True):
        if key in table:
            value = np.atleast_1d(np.asarray(table[key], object))
            numbers = [document.number(x, key) for x in value.ravel()]
            if (size := float(np.sqrt(np.mean(np.square(numbers))))) > 0:
                found[name] = size
    return found


def kalibr_noise(document: Document) -> dict[str, float]:
    """Return the densities of Kalibr's imu.yaml, or of EuRoC's imu0/sensor.yaml. Raises ConfigError."""
    return noise_of(document, {**document.data, **_table(document.data)}, _KALIBR)


def of_toml(document: Document) -> ImuCalibration | None:
    """Return the unit in the section [imu] of our own format."""
    table = document.data.get("imu")
    if table is None:
        return None
    if not isinstance(table, Mapping) or (unknown := sorted(set(table) - set(KEYS))):
        more = "" if not isinstance(table, Mapping) else f", not {unknown[0]!r}"
        raise document.error(f"imu must be a section with {', '.join(KEYS)}{more}")
    if "cam_from_imu" not in table:
        raise document.error("imu.cam_from_imu, a 4×4 matrix in metres, is missing")
    numbers = {key: document.number(table[key], f"imu.{key}") for key in KEYS[1:] if key in table}
    return imu_of(document, document.numbers(table["cam_from_imu"], "imu.cam_from_imu", (4, 4)), numbers)


def lines(imu: ImuCalibration) -> list[str]:
    """Return the section [imu] of our own format."""
    rows = [f"cam_from_imu = {imu.cam_from_imu.tolist()}"]
    return ["", "[imu]", *rows, *(f"{key} = {float(getattr(imu, key))!r}" for key in KEYS[1:])]


def of_kalibr(document: Document) -> ImuCalibration | None:
    """Return the unit of a camchain (T_cam_imu, or T_imu_cam of OpenVINS), with the noise of an imu.yaml beside it."""
    cam0 = document.data.get("cam0")
    if not isinstance(cam0, Mapping):
        return None
    pose = cam_from_imu_of(document, cam0, "cam0")
    noise = kalibr_noise(document)
    if "timeshift_cam_imu" in cam0:  # t_imu = t_cam + shift
        noise["time_offset_s"] = document.number(cam0["timeshift_cam_imu"], "cam0.timeshift_cam_imu")
    return imu_of(document, pose, noise)


def cam_from_imu_of(document: Document, cam: Mapping[str, Any], name: str) -> Array | None:
    """Return cam_from_imu (4, 4) of a camera in a chain, which may contain the inverse; None without either."""
    if "T_cam_imu" in cam:
        return document.pose(cam["T_cam_imu"], f"{name}.T_cam_imu")
    if "T_imu_cam" in cam:
        return np.asarray(se3.inverse(document.pose(cam["T_imu_cam"], f"{name}.T_imu_cam")))
    return None


def of_basalt(document: Document, imu_from_cam: Array, values: Mapping[str, Any]) -> ImuCalibration | None:
    """Return the unit of a calibration of Basalt; `imu_from_cam` (4, 4) is the pose of the left camera on it."""
    noise = noise_of(document, values, _BASALT)
    noise["time_offset_s"] = 1e-9 * document.number(values.get("cam_time_offset_ns", 0), "cam_time_offset_ns")
    return imu_of(document, np.asarray(se3.inverse(imu_from_cam)), noise)


def of_orb_slam(document: Document) -> ImuCalibration | None:
    """Return the unit of settings of ORB-SLAM3: IMU.T_b_c1 carries points of the left camera into the unit."""
    key = next((k for k in ("IMU.T_b_c1", "Tbc") if k in document.data), None)
    if key is None:
        return None
    pose = np.asarray(se3.inverse(document.pose(document.data[key], key)))
    return imu_of(document, pose, noise_of(document, document.data, _ORB_SLAM))


def of_vins(document: Document, imu_from_cam: Array) -> ImuCalibration | None:
    """Return the unit of VINS-Fusion, whose body it is; its noise is tuned, and is not that of a data sheet."""
    shift = {"time_offset_s": document.number(document.data.get("td", 0.0), "td")}  # t_imu = t_cam + td
    return imu_of(document, np.asarray(se3.inverse(imu_from_cam)), shift) if document.data.get("imu", 1) else None


def of_euroc(document: Document) -> ImuCalibration | None:
    """Return the unit of the left camera's sensor.yaml, whose body is the unit of EuRoC."""
    pose = np.asarray(se3.inverse(document.pose(document.data["T_BS"], "T_BS")))
    return imu_of(document, pose, kalibr_noise(document))
