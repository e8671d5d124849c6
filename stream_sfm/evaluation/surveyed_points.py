"""Surveyed test points: what is measured in the world, and where it is seen in the images; read from a TOML file.

world = "survey"          # whose coordinates: "survey", "first camera" or "ground truth"
std_px = 0.5              # σ of u and of v below
std_m = 0.001             # σ of each coordinate

[points]                  # metres
door_handle = [0.512, -0.130, 2.417]

[[seen]]
point = "door_handle"
frame = 0                 # of the run, counted from 0; or stamp_ns, of the left image
left = [312.4, 201.7]     # u, v in the image as recorded; (0, 0) is the centre of the top-left pixel
right = [254.1, 202.0]    # may be left out
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError
from ..geometry.se3 import Array
from ..inputs import INT64, parse_toml, read_small
from ..wording import invalid_setting

World = Literal["survey", "first camera", "ground truth"]
NO_FRAME = -1
_MAX_BYTES = 2**24  # a hundred thousand sightings
_MAX_M = 1e6


class _Seen(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    point: str
    left: tuple[float, float]
    right: tuple[float, float] | None = None
    frame: int | None = None
    stamp_ns: int | None = None


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    points: dict[str, tuple[float, float, float]]
    seen: tuple[_Seen, ...]
    world: World = "survey"
    std_px: float = 0.5
    std_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SurveyedPoints:
    """Test points with their coordinates (k, 3), metres ± `std_m`, and n sightings of them.

    `world`: the coordinates are of the first left camera's axes, of the ground truth's world, or of the survey's own
    axes, which the first frame with three points then ties to the run. Of each sighting: `point_rows` (n,), the place
    of its point; `frames` (n,) of the run, or -1 and `stamps_ns` (n,) of the left image; `left_px`, `right_px` (n, 2)
    in the images as recorded, ± `std_px`, the right one NaN where it was not found.
    """

    names: tuple[str, ...]
    positions_m: Array
    point_rows: NDArray[np.int64]
    frames: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    left_px: Array
    right_px: Array
    world: World = "survey"
    std_px: float = 0.5
    std_m: float = 0.0

    def __post_init__(self) -> None:
        if not len(self.names) or not len(self.point_rows):
            raise ConfigError(
                "test points: give points and where they are seen; there is nothing to compare without"
            )
        if not (self.std_px > 0 and np.isfinite(self.std_px)):
            raise ConfigError(f"test points: std_px is {self.std_px:g}; give the σ of a pixel coordinate, above 0")
        if not (self.std_m >= 0 and np.isfinite(self.std_m)):
            raise ConfigError(
                f"test points: std_m is {self.std_m:g}; give the σ of a coordinate in metres, 0 or more"
            )
        if self.world not in ("survey", "first camera", "ground truth"):
            raise ConfigError(f"test points: world is {self.world!r}; give survey, first camera or ground truth")
        if not (np.abs(self.positions_m) < _MAX_M).all():  # false for NaN too
            raise ConfigError(f"test points: coordinates must be finite, in metres and below {_MAX_M:g}")
        if not np.isfinite(self.left_px).all() or np.isinf(self.right_px).any():
            raise ConfigError("test points: pixels must be finite numbers")

    def __repr__(self) -> str:
        return f"<SurveyedPoints {len(self.names)} points, {len(self.point_rows)} sightings>"


def read_surveyed_points(path: str | Path) -> SurveyedPoints:
    """Read surveyed points from a TOML file. Raises ConfigError naming the file and what is wrong in it."""
    try:
        data = parse_toml(read_small(path, _MAX_BYTES).decode("utf-8-sig"))
    except OSError as error:
        raise ConfigError(f"cannot read test points {path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"test points {path} are not TOML: {error}") from None
    try:
        return _points(_converted(data))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def _converted(data: dict[str, Any]) -> _File:
    """The content of a file, each value of the right kind. Raises ConfigError."""
    try:
        return msgspec.convert(data, _File)
    except msgspec.ValidationError as error:
        raise ConfigError(f"test points: {_explained(str(error), data)}") from None


def _explained(problem: str, data: dict[str, Any]) -> str:
    """What is wrong with the content of a file: the key, and what belongs there."""
    known = dict.fromkeys(_File.__struct_fields__)
    if not set(data) <= set(known):
        return invalid_setting(problem, data, known)
    what, _, where = problem.partition(" - at `$.")
    place = f" at {where.rstrip('`')}" if where else ""
    return (
        f"{what[0].lower()}{what[1:]}{place}; a point is name = [x, y, z], a sighting point, frame, left and right"
    )


def _points(content: _File) -> SurveyedPoints:
    names = tuple(content.points)
    for number, seen in enumerate(content.seen):
        where = f"test points: sighting {number} of {seen.point!r}"
        if seen.point not in content.points:
            raise ConfigError(f"{where}: there is no point of this name in [points]")
        if (seen.frame is None) == (seen.stamp_ns is None):
            raise ConfigError(f"{where}: give its frame, or stamp_ns of its left image; one of the two")
        if not 0 <= (seen.frame if seen.frame is not None else seen.stamp_ns or 0) < INT64:
            raise ConfigError(f"{where}: frame and stamp_ns are whole numbers of 0 or more")
    rows = {name: row for row, name in enumerate(names)}
    absent = (float("nan"), float("nan"))
    return SurveyedPoints(
        names,
        np.array(list(content.points.values()), float).reshape(-1, 3),
        np.array([rows[s.point] for s in content.seen], np.int64),
        np.array([NO_FRAME if s.frame is None else s.frame for s in content.seen], np.int64),
        np.array([s.stamp_ns or 0 for s in content.seen], np.int64),
        np.array([s.left for s in content.seen], float).reshape(-1, 2),
        np.array([s.right or absent for s in content.seen], float).reshape(-1, 2),
        content.world,
        content.std_px,
        content.std_m,
    )
