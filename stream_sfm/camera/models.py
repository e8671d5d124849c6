"""Camera models: one pinhole camera with its lens, the stereo rig, the rig of one camera."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import ConfigError
from ..geometry import se3
from ..geometry.se3 import Array

MAX_PIXELS = 2**25  # of an image: more is a damaged header, or hostile
DISTORTION_COEFFICIENTS = {
    "none": (0,),
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (8,),
    "equidistant": (4,),
}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Camera:
    """One pinhole camera as delivered, before rectification.

    `K` (3, 3) pixels; `D` distortion coefficients in OpenCV's order; `distortion_model` one of none, plumb_bob
    (4 or 5), rational_polynomial (8), equidistant (4). Raises ConfigError for the impossible.
    """

    width: int
    height: int
    K: Array
    D: tuple[float, ...] = ()
    distortion_model: str = "plumb_bob"

    def __post_init__(self) -> None:
        k = np.array(self.K, dtype=float)
        d = tuple(float(x) for x in np.ravel(np.asarray(self.D, dtype=float)))
        object.__setattr__(self, "K", k)
        object.__setattr__(self, "D", d)
        if self.width < 16 or self.height < 16 or self.width * self.height > MAX_PIXELS:
            raise ConfigError(
                f"camera size {self.width}×{self.height}: give width and height in pixels, each at least 16, "
                f"together at most {MAX_PIXELS / 1e6:.0f} megapixels"
            )
        if k.shape != (3, 3) or not np.isfinite(k).all():
            raise ConfigError(f"camera matrix K must be 3×3 and finite, got shape {k.shape}: {k.tolist()}")
        if k[0, 0] <= 0 or k[1, 1] <= 0 or not np.allclose(k[2], (0, 0, 1)):
            raise ConfigError(
                f"camera matrix K must have fx, fy > 0 and last row 0 0 1, got {k.tolist()}: "
                "is the camera calibrated?"
            )
        allowed = DISTORTION_COEFFICIENTS.get(self.distortion_model)
        if allowed is None:
            names = ", ".join(DISTORTION_COEFFICIENTS)
            raise ConfigError(f"distortion model {self.distortion_model!r} is not known; known are {names}")
        if not np.isfinite(d).all() or (any(d) and len(d) not in allowed):
            raise ConfigError(
                f"distortion model {self.distortion_model} takes {allowed} finite coefficients, got {list(d)}"
            )

    def __repr__(self) -> str:
        (fx, _, cx), (_, fy, cy) = self.K[:2]
        lens = self.distortion_model if any(self.D) else "no distortion"
        return f"<Camera {self.width}×{self.height} f=({fx:.2f}, {fy:.2f}) c=({cx:.2f}, {cy:.2f}) px, {lens}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StereoRig:
    """Two cameras and `right_from_left` (4, 4), metres: carries points of the left camera into the right one.

    Raises ConfigError where the pair cannot be a stereo pair.
    """

    left: Camera
    right: Camera
    right_from_left: Array

    def __post_init__(self) -> None:
        pose = np.array(self.right_from_left, dtype=float)
        if pose.shape != (4, 4) or not (np.abs(pose) < 1e6).all():  # false for NaN too
            raise ConfigError(f"right_from_left must be a 4×4 pose in metres, got {pose.tolist()}")
        r = pose[:3, :3]
        if not np.allclose(r @ r.T, np.eye(3), atol=1e-3) or np.linalg.det(r) < 0:
            raise ConfigError(f"right_from_left holds no rotation: {r.tolist()}")
        object.__setattr__(self, "right_from_left", se3.orthonormalise(pose))
        if (self.left.width, self.left.height) != (self.right.width, self.right.height):
            raise ConfigError(
                f"left images are {self.left.width}×{self.left.height}, right ones "
                f"{self.right.width}×{self.right.height}: both must have one size"
            )
        if self.baseline_m < 1e-4:
            raise ConfigError(
                f"the baseline is {self.baseline_m:g} m: give right_from_left in metres; in a ROS calibration it "
                "is −P[3]/P[0] of the right camera, which must not be zero"
            )

    @property
    def cameras(self) -> dict[str, Camera]:
        """Name -> camera, in the order of a frame's images."""
        return {"left": self.left, "right": self.right}

    def __repr__(self) -> str:
        return f"<StereoRig baseline {self.baseline_m:.4f} m, left {self.left!r}, right {self.right!r}>"

    @property
    def baseline_m(self) -> float:
        """Distance between the two camera centres, metres."""
        return float(np.linalg.norm(self.right_from_left[:3, 3]))

    @classmethod
    def from_calibration(cls, path: str | Path) -> "StereoRig":
        """Read a calibration file (TOML, described in docs/formats.md). Raises ConfigError."""
        from .calibration_file import read_calibration

        return read_calibration(path)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MonoRig:
    """One camera: the scale of what it sees is not observable (`Config.mono`)."""

    left: Camera

    @property
    def cameras(self) -> dict[str, Camera]:
        """As in StereoRig."""
        return {"left": self.left}

    def __repr__(self) -> str:
        return f"<MonoRig {self.left!r}>"

    @classmethod
    def from_calibration(cls, path: str | Path) -> "MonoRig":
        """The left camera of a calibration file, which needs no other section. Raises ConfigError."""
        from .calibration_file import read_camera

        return read_camera(path)
