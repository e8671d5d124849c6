"""Two sets of image files and a calibration file to a log."""

import glob
import re
from pathlib import Path

from ..calibration import read_calibration
from ..errors import ConfigError, InputError
from .common import ImageFile, Imported, ascending, read_text, seconds_to_ns, write_images


def import_images(
    left: str,
    right: str,
    calibration: str | Path,
    out: str | Path,
    stamps: str | Path | None = None,
    rate_hz: float = 10.0,
) -> Imported:
    """The images that match the globs `left` and `right`, paired in order of their names, as a log at `out`.

    `stamps`: a file with one time a line, seconds with a decimal point or integer nanoseconds; without it the
    frames are put `rate_hz` apart. Raises InputError, ConfigError, OutputError.
    """
    rig = read_calibration(calibration)
    sides = [_matches("--left", left), _matches("--right", right)]
    if len(sides[0]) != len(sides[1]):
        raise InputError(
            f"--left {left} matches {len(sides[0])} images, --right {right} matches {len(sides[1])}: both must "
            "match as many, because they are paired in order of their names"
        )
    if both := set(sides[0]) & set(sides[1]):
        raise ConfigError(f"{min(both)} matches --left and --right: give two different globs")
    warnings = []
    if stamps is not None:
        times = _read_stamps(Path(stamps))
        if len(times) != len(sides[0]):
            raise InputError(f"{stamps} has {len(times)} times for {len(sides[0])} pairs of images")
    elif not 0 < rate_hz < 1e6:
        raise ConfigError(f"the rate must be a positive number of frames a second, got {rate_hz:g}")
    else:
        times = [round(n * 1e9 / rate_hz) for n in range(len(sides[0]))]
        warnings.append(f"no stamps were given: frames are {1 / rate_hz:g} s apart")
    images = tuple([ImageFile(s, f) for s, f in zip(times, side, strict=True)] for side in sides)
    return write_images(out, rig, (images[0], images[1]), warnings=warnings)


def _matches(option: str, pattern: str) -> list[Path]:
    """Files in natural order: image_2 before image_10. Raises InputError where there is none."""
    found = [Path(p) for p in glob.glob(pattern, recursive=True) if Path(p).is_file()]
    if not found:
        raise InputError(f"{option} {pattern}: no file matches; quote the glob so that the shell leaves it alone")
    return sorted(found, key=lambda p: [(int(t), "") if t.isdecimal() else (-1, t) for t in _tokens(str(p))])


def _tokens(text: str) -> list[str]:
    return [t for t in re.split(r"(\d+)", text) if t]


def _read_stamps(path: Path) -> list[int]:
    lines = read_text(path, "stamps").split()
    times = [
        int(t) if t.isdecimal() and len(t) > 12 else seconds_to_ns(t, f"{path}, line {n}")
        for n, t in enumerate(lines, start=1)
    ]
    ascending(times, path)
    return times
