"""Rigs: the two cameras, or one, from which images come."""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar, TypeVar

import numpy as np

from ..config import Config
from ..errors import ConfigError, as_error
from ..geometry import Array, se3
from ..inertial.samples import ImuCalibration
from ..record import record, settle
from ..system.wording import described
from .calibration import toml_file
from .calibration.document import Pair, Where, load, named, short
from .masks import Mask, read_mask
from .models import Camera
from .refinement import KnownTiming, Refinement
from .settings import SETTINGS

MaskOrFile = Mask | str | Path
_ADDED = {"refinement": Refinement, "timing": KnownTiming, "imu": ImuCalibration}  # optional parts of a rig


@record
class StereoRig:
    """Two cameras and `right_from_left` (4, 4), metres: carries points of the left camera into the right one.

    `refinement`: known errors of this calibration; `timing`: known delay and readout; `imu`: how an inertial unit
    is mounted. `unscaled`: whether lengths have no unit. Raises ConfigError if this cannot be a stereo pair.
    """

    unscaled: ClassVar[bool] = False
    left: Camera
    right: Camera
    right_from_left: Array
    refinement: Refinement | None = None
    timing: KnownTiming | None = None
    imu: ImuCalibration | None = None

    def __post_init__(self) -> None:
        for name, kind in (("left", Camera), ("right", Camera), *_ADDED.items()):
            value = getattr(self, name)
            if not isinstance(value, kind) and (value is not None or name not in _ADDED):
                raise ConfigError(f"{name} of the rig is {described(value)}; give {kind.__name__}(…)")
        settle(self, "right_from_left", checked_pose(self.right_from_left))
        if (self.left.width, self.left.height) != (self.right.width, self.right.height):
            sizes = [f"{camera.width}×{camera.height}" for camera in self.cameras.values()]
            raise ConfigError(f"left images are {sizes[0]}, right ones {sizes[1]}: both must have one size")
        if self.baseline_m < 1e-4:  # 0.1 mm: less means a P without baseline, not a pair
            cure = "give right_from_left in metres; in ROS, P[3] of the right camera must not be zero"
            raise ConfigError(f"the baseline is {self.baseline_m:g} m: {cure}")

    @property
    def cameras(self) -> dict[str, Camera]:
        """Name -> camera, in the order of the images of a frame."""
        return {"left": self.left, "right": self.right}

    def __repr__(self) -> str:
        return f"<StereoRig baseline {self.baseline_m:.4f} m, left {self.left!r}, right {self.right!r}>"

    @property
    def baseline_m(self) -> float:
        """Distance between the two camera centres, metres."""
        return float(np.linalg.norm(self.right_from_left[:3, 3]))

    @classmethod
    def from_calibration(cls, path: Where, image_size: tuple[int, int] | None = None) -> "StereoRig":
        """Read a calibration. Raises ConfigError naming file and key.

        `path` is a file, the two files of left and right, or the folder they are in, in any format of docs/formats.md.
        `image_size` (width, height) is for formats that do not contain it.
        """
        from .calibration.read import documents_at, pair_of  # late, as few runs need all formats

        return cls._of_pair(pair_of(documents_at(path), image_size), path)

    @classmethod
    def parse_calibration(cls, content: bytes, name: str | Path) -> "StereoRig":
        """Read the content of a calibration file; errors call it `name`. Raises as `from_calibration`."""
        from .calibration.read import pair_of

        return cls._of_pair(pair_of([load(content, name)], None), name)

    @classmethod
    def _of_pair(cls, pair: Pair, name: Where) -> "StereoRig":
        with as_error(ConfigError, f"calibration {named(name)}", ConfigError):
            return cls(*pair)

    def masked(self, left: MaskOrFile | None, right: MaskOrFile | None = None) -> "StereoRig":
        """Return the rig with masks: no point is followed where images always show the robot, or dirt.

        `left`, `right`: PNG files of the size of the images, black in these places, or arrays (h, w) that are 0
        there; None: no mask. Raises ConfigError.
        """
        return replace(self, left=_masked(self.left, left), right=_masked(self.right, right))

    def to_toml(self) -> str:
        """Return the text of a calibration file that `from_calibration` reads back unchanged, except for masks."""
        return toml_file.text(self.cameras, self.right_from_left, self.refinement, self.timing, self.imu)


@record
class MonoRig:
    """One camera: the scale of the scene is not observable (`Config.mono`)."""

    unscaled: ClassVar[bool] = True
    left: Camera

    @property
    def cameras(self) -> dict[str, Camera]:
        """Name -> camera, as in `StereoRig`."""
        return {"left": self.left}

    def __repr__(self) -> str:
        return f"<MonoRig {self.left!r}>"

    @classmethod
    def from_calibration(cls, path: Where, image_size: tuple[int, int] | None = None) -> "MonoRig":
        """Read the left camera of a calibration, which may be the only one, as `StereoRig.from_calibration`."""
        from .calibration.read import documents_at, left_of

        return cls(left_of(documents_at(path), image_size))

    @classmethod
    def parse_calibration(cls, content: bytes, name: str | Path) -> "MonoRig":
        """Read the content of a calibration file; errors call it `name`. Raises as `from_calibration`."""
        from .calibration.read import left_of

        return cls(left_of([load(content, name)], None))

    def masked(self, left: MaskOrFile | None, right: MaskOrFile | None = None) -> "MonoRig":
        """Return the rig with a mask, as `StereoRig.masked`."""
        return MonoRig(_masked(self.left, left))

    def to_toml(self) -> str:
        """Return the text of a calibration file that `from_calibration` reads back unchanged, except for masks."""
        return toml_file.text(self.cameras)


def _masked(camera: Camera, mask: MaskOrFile | None) -> Camera:
    """Return the camera with a mask from a file or an array; unchanged without one."""
    if mask is None:
        return camera
    if isinstance(mask, str | Path):
        mask = read_mask(mask, camera.width, camera.height)
    return replace(camera, mask=mask)


Rig = TypeVar("Rig", StereoRig, MonoRig, StereoRig | MonoRig)


def masked_by(config: Config, rig: Rig) -> Rig:
    """Return a rig with the masks of a configuration. Raises ConfigError if they do not fit."""
    if not (config.mask_left or config.mask_right):
        return rig
    return rig.masked(config.mask_left or None, config.mask_right or None)


def baseline_warnings(rig: StereoRig | MonoRig) -> list[str]:
    """Return at most one question, about a baseline that is probably not in metres."""
    low_m, high_m = SETTINGS.usual_baseline_m
    if isinstance(rig, MonoRig) or low_m <= rig.baseline_m <= high_m:
        return []
    unit = "millimetres" if rig.baseline_m > high_m else "another unit"
    question = f"the baseline of the calibration is {rig.baseline_m:.4g} m: are these {unit}?"
    return [f"{question} Lengths must be in metres, because all estimated lengths depend on the baseline"]


def checked_pose(given: object, name: str = "right_from_left") -> Array:
    """Return a pose (4, 4) in metres as an array with an exact rotation. Raises ConfigError, which calls it `name`."""
    wanted = f"{name} must be a 4×4 pose in metres"
    try:
        pose: Array = np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise ConfigError(
            f"{wanted}, got {short(given, 120)}; of rotation and translation it is [[R, t], [0, 1]]"
        ) from None
    if pose.shape != (4, 4) or not (np.abs(pose) < 1e6).all():  # metres; larger values and NaN mean a damaged file
        raise ConfigError(f"{wanted}, got {pose.tolist()}")
    if not np.allclose(pose[3], (0, 0, 0, 1)):
        turned = "; it is transposed" if np.allclose(pose[:, 3], (0, 0, 0, 1)) else ""
        raise ConfigError(f"{wanted} with the last row 0 0 0 1, got {pose.tolist()}{turned}")
    if not se3.is_rotation(pose[:3, :3]):
        raise ConfigError(f"{name} holds no rotation: {pose[:3, :3].tolist()}")
    return se3.orthonormalise(pose)


def checked_paths(calibration: Where) -> list[Path]:
    """Return the absolute paths of a calibration for other processes. Raises ConfigError, once for all logs."""
    StereoRig.from_calibration(calibration, image_size=(1000, 1000))  # pixels: any size will do
    return [Path(p).resolve() for p in ([calibration] if isinstance(calibration, str | Path) else calibration)]
