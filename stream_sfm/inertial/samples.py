"""Samples of a gyroscope and an accelerometer for frames, and the calibration of their unit."""

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError, FrameError
from ..geometry import Array, se3
from ..record import record, settle

_SHAPES = "stamps_ns (n,) of integers, gyro_rad_s (n, 3) and accel_m_s2 (n, 3)"


@record
class ImuSamples:
    """Samples of an inertial unit: `stamps_ns` (n,), `gyro_rad_s` (n, 3) and `accel_m_s2` (n, 3), in its own axes.

    The accelerometer measures the specific force: at rest, 9.81 m/s² upwards. A frame has all samples since the
    previous frame, and one beyond if it is already available. Raises FrameError for arrays of another shape or
    type.
    """

    stamps_ns: NDArray[np.int64]
    gyro_rad_s: Array
    accel_m_s2: Array

    def __post_init__(self) -> None:
        try:
            stamps = np.asarray(self.stamps_ns)
            arrays = [np.ascontiguousarray(a, float) for a in (self.gyro_rad_s, self.accel_m_s2)]
        except (TypeError, ValueError):
            raise FrameError(f"inertial samples are not arrays of numbers: give {_SHAPES}") from None
        whole = stamps.dtype.kind in "iu" or not stamps.size
        if stamps.ndim != 1 or not whole or any(a.shape != (len(stamps), 3) for a in arrays):
            shapes = ", ".join(str(a.shape) for a in (stamps, *arrays))
            raise FrameError(f"inertial samples have shapes {shapes} and stamps of {stamps.dtype}: give {_SHAPES}")
        settle(self, "stamps_ns", stamps.astype(np.int64))
        settle(self, "gyro_rad_s", arrays[0])
        settle(self, "accel_m_s2", arrays[1])

    @classmethod
    def joined(cls, parts: "list[ImuSamples]") -> "ImuSamples":
        """Return the samples of several consecutive records."""
        if not parts:
            return cls(np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3)))
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in cls.__annotations__))

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __getitem__(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp]) -> "ImuSamples":
        return ImuSamples(self.stamps_ns[rows], self.gyro_rad_s[rows], self.accel_m_s2[rows])

    def __repr__(self) -> str:
        return f"<ImuSamples {len(self)}>"


@record
class ImuCalibration:
    """The mounting and the errors of an inertial unit.

    `cam_from_imu` (4, 4): carries points in axes of the unit into the left camera, metres. Noise densities of the
    gyroscope, rad/s/√Hz, and the accelerometer, m/s²/√Hz, and of their walks, rad/s²/√Hz and m/s³/√Hz: those of a
    data sheet will do, as factors are learnt. `time_offset_s`: clock of the unit minus clock of the camera.
    `gyro_range_rad_s`, `accel_range_m_s2`: where samples saturate. Raises ConfigError for impossible values.
    """

    cam_from_imu: Array = field(default_factory=lambda: np.eye(4))
    gyro_noise: float = 2e-4  # those of a consumer-grade unit (BMI160)
    gyro_walk: float = 3e-5
    accel_noise: float = 3e-3
    accel_walk: float = 5e-4
    time_offset_s: float = 0.0
    gyro_range_rad_s: float = 35.0  # 2000 °/s, the widest usual range
    accel_range_m_s2: float = 160.0  # 16 g

    def __post_init__(self) -> None:
        try:
            pose = np.array(self.cam_from_imu, float)
        except (TypeError, ValueError):
            pose = np.zeros(0)
        if pose.shape != (4, 4) or not np.isfinite(pose).all() or not se3.is_rotation(pose[:3, :3], se3.ROUNDED):
            raise ConfigError("cam_from_imu of the inertial unit is not a 4×4 pose: give [[R, t], [0, 1]] in metres")
        settle(self, "cam_from_imu", se3.orthonormalise(pose))
        for name in _NUMBERS:
            value = getattr(self, name)
            is_number = isinstance(value, int | float) and np.isfinite(value)
            if not is_number or (name != "time_offset_s" and not value > 0) or abs(value) > 1e4:
                raise ConfigError(f"imu {name} is {value!r}: give a number above 0 in SI units and per √Hz")

    def mounted_in(self, rect_from_cam: Array) -> "ImuCalibration":
        """Return the calibration for a camera whose axes are turned by (3, 3)."""
        turned = se3.from_rotation_translation(rect_from_cam, np.zeros(3)) @ self.cam_from_imu
        return ImuCalibration(turned, *(getattr(self, name) for name in _NUMBERS))

    def __repr__(self) -> str:
        return f"<ImuCalibration {np.linalg.norm(self.cam_from_imu[:3, 3]):.3f} m from the camera>"


_NUMBERS = tuple(ImuCalibration.__annotations__)[1:]
