"""Two sets of image files and a calibration file to a log."""

import glob
import re
from collections.abc import Sequence
from pathlib import Path

from ..camera.rig import StereoRig
from ..errors import ConfigError, InputError
from .common import ImageFile, Imported, ascending, read_text, seconds_to_ns, write_images

_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")


def import_images(
    left: str | Sequence[str],
    right: str | Sequence[str],
    calibration: str | Path,
    out: str | Path,
    stamps: str | Path | None = None,
    rate_hz: float = 10.0,
) -> Imported:
    """The images `left` and `right`, paired in order of their names, as a log at `out`.

    Each side is one or several files, folders or globs. `stamps`: a file with one time a line, seconds with a
    decimal point or integer nanoseconds; without it the frames are put `rate_hz` apart. Raises InputError,
    ConfigError, OutputError.
    """
    rig = StereoRig.from_calibration(calibration)
    sides = [_matches("left", left), _matches("right", right)]
    if both := set(sides[0]) & set(sides[1]):
        raise ConfigError(
            f"{min(both)} is both a left and a right image: give two different globs", hint=("left", "right")
        )
    _check_partners(*sides)
    warnings = []
    if stamps is not None:
        times = _read_stamps(Path(stamps))
        if len(times) != len(sides[0]):
            raise InputError(f"{stamps} has {len(times)} times for {len(sides[0])} pairs of images")
    elif not 0 < rate_hz < 1e6:
        raise ConfigError(f"the rate must be a positive number of frames a second, got {rate_hz:g}")
    else:
        times = [round(n * 1e9 / rate_hz) for n in range(len(sides[0]))]
        warnings.append(
            f"no stamps were given: frames are {1 / rate_hz:g} s apart, as the rate of {rate_hz:g} Hz says"
        )
    images = tuple([ImageFile(s, f) for s, f in zip(times, side, strict=True)] for side in sides)
    return write_images(out, rig, (images[0], images[1]), warnings=warnings)


def _matches(side: str, patterns: str | Sequence[str]) -> list[Path]:
    """Files in natural order: image_2 before image_10. Raises InputError where there is none."""
    found: set[Path] = set()
    for pattern in [patterns] if isinstance(patterns, str) else patterns:
        if Path(pattern).is_dir():
            matches = [p for p in Path(pattern).iterdir() if p.suffix.lower() in _SUFFIXES]
        elif Path(pattern).is_file():  # a name may hold what a glob means otherwise
            matches = [Path(pattern)]
        else:
            matches = [Path(p) for p in glob.glob(pattern, recursive=True) if Path(p).is_file()]
        if not matches:
            raise InputError(
                f"{pattern} matches no {side} image: give files, a folder, or a glob such as 'l/*.png'",
                hint=(side,),
            )
        found.update(matches)
    return sorted(found, key=lambda p: [(int(t), "") if t.isdecimal() else (-1, t) for t in _tokens(str(p))])


def _check_partners(left: list[Path], right: list[Path]) -> None:
    """Raises InputError where the order of names would pair images of different moments, as far as names tell."""
    numbers = [{_number(p): p for p in side} for side in (left, right)]
    numbered = all(len(n) == len(side) for n, side in zip(numbers, (left, right), strict=True))
    alone = sorted(str(n[k]) for n, other in (numbers, numbers[::-1]) for k in n.keys() - other.keys())
    if numbered and alone and numbers[0].keys() & numbers[1].keys():
        raise InputError(
            f"{len(alone)} of {len(left)} left and {len(right)} right images have no partner of the same number, the "
            f"first: {alone[0]}; leave them out"
        )
    if len(left) != len(right):
        raise InputError(
            f"there are {len(left)} left and {len(right)} right images: both must be as many, because they are "
            "paired in order of their names"
        )


def _number(path: Path) -> str:
    """The last number in the name of a file, else the name."""
    numbers = re.findall(r"\d+", path.stem)
    return str(int(numbers[-1])) if numbers else path.stem


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
