"""Sets of image files: which files in a folder are left and right, by their names, and how the two sides are paired.

A side is folders, globs or files. Stamps are in a file, in the names, or missing.
"""

import glob
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from ...camera.rig import StereoRig
from ...errors import ConfigError, LogError
from ...record import record
from .image_files import ImageFile, ImageFilesSource
from .image_header import IMAGE_SUFFIXES
from .image_stamps import listed_stamps, named_stamps
from .joined import natural_order
from .pose_files import read_times
from .sides import RULES, is_camera, possible_pairs, side_keys

DEFAULT_RATE_HZ = 10.0
_OF_KITTI = ("image_2", "image_3")  # the colour cameras, which the naming rules do not pair
_MOST_FOLDERS = 200  # per folder that are searched


def open_images(
    left: str | Sequence[str],
    right: str | Sequence[str],
    rig: StereoRig | None,
    stamps: str | Path | None = None,
    rate_hz: float | None = None,
    path: Path | None = None,
) -> ImageFilesSource:
    """Open the images `left` and `right`, each files, folders or globs. Raises LogError, ConfigError.

    `stamps`: a file with one time per line, seconds with a decimal point or whole nanoseconds; without it those in the
    names or in a table of the names are used, otherwise frames follow at `rate_hz`. `path` names the recording. One
    camera has no `right`.
    """
    sides = [_matches("left", left), _matches("right", right)]
    if both := set(sides[0]) & set(sides[1]):
        problem = f"{min(both)} is both a left and a right image: give two different globs"
        raise ConfigError(problem, hint=("left", "right"))
    path = path if path is not None else sides[0][0].parent
    notes: list[str] = []
    own = [None, None] if stamps is not None or rate_hz is not None else _own_stamps(sides, path, notes)
    if own[0] is not None and own[1] is not None:
        left_images, right_images = (_stamped(t or (), side) for t, side in zip(own, sides, strict=True))
        return ImageFilesSource(path, "image files", rig, (left_images, right_images), notes=notes)
    places, count = _places(*sides)
    if own[0] is not None and sorted(places[0]) == list(range(count)):  # those of the left images are for both
        times = sorted(own[0])
    elif stamps is not None:
        times = read_times(Path(stamps))
        if len(times) != count:
            raise LogError(f"{stamps} has {len(times)} times for {count} pairs of images; give one line for each")
    else:
        if rate_hz is None:
            rate_hz = DEFAULT_RATE_HZ
            notes.append(f"no stamps and no rate were given: frames are {1 / rate_hz:g} s apart")
        if not 0 < rate_hz < 1e6:
            raise ConfigError(f"the rate must be a positive number of frames per second, got {rate_hz:g}")
        times = [round(n * 1e9 / rate_hz) for n in range(count)]
    left_images, right_images = (
        sorted(_stamped([times[n] for n in of_side], side), key=lambda image: image.stamp_ns)
        for of_side, side in zip(places, sides, strict=True)
    )
    return ImageFilesSource(path, "image files", rig, (left_images, right_images), notes=notes)


def _own_stamps(sides: Sequence[Sequence[Path]], path: Path, notes: list[str]) -> list[list[int] | None]:
    """Return the stamps of each side in the names of its files, or else in a table, which is added to the notes."""
    named = [named_stamps(side) for side in sides]
    if None not in named:
        return named
    listed = [listed_stamps(side, path) for side in sides]
    tables = dict.fromkeys(str(table) for found in listed if found is not None for table in found[1:])
    notes += [f"the stamps are those of {' and '.join(tables)}"] if tables else []
    return [found[0] if found is not None else name for found, name in zip(listed, named, strict=True)]


def _stamped(times: Sequence[int], files: Sequence[Path]) -> list[ImageFile]:
    return [ImageFile(time, file) for time, file in zip(times, files, strict=True)]


def first_image(patterns: str | Sequence[str]) -> Path | None:
    """Return one file of a side, which gives the size of all; None if there is none."""
    try:
        return _matches("left", patterns)[0]
    except LogError:
        return None


def images_in(folder: Path) -> list[Path]:
    """Return the image files in a folder, unordered."""
    with os.scandir(folder) as entries:
        return [Path(entry.path) for entry in entries if entry.name.lower().endswith(IMAGE_SUFFIXES)]


def _matches(side: str, patterns: str | Sequence[str]) -> list[Path]:
    """Return files in natural order: image_2 before image_10. Raises LogError if there is none."""
    found: set[Path] = set()
    for pattern in [patterns] if isinstance(patterns, str) else patterns:
        if os.path.isdir(pattern):
            matches = images_in(Path(pattern))
        elif os.path.isfile(pattern):  # a name may contain special characters of globs
            matches = [Path(pattern)]
        else:
            matches = [Path(p) for p in glob.glob(pattern, recursive=True) if Path(p).is_file()]
        if not matches:
            problem = f"{pattern} matches no {side} image: give files, a folder, or a glob such as 'l/*.png'"
            raise LogError(problem, hint=(side,))
        found.update(matches)
    return sorted(found, key=lambda p: natural_order(str(p)))


def _places(left: list[Path], right: list[Path]) -> tuple[list[list[int]], int]:
    """Return the place in time of each image of both sides, and the number of places.

    Images of the same number belong together; an image without a partner keeps its place, but makes no pair. Raises
    LogError if names do not tell which images belong together and the sides have different numbers of images.
    """
    if not right:
        return [list(range(len(left))), []], len(left)
    numbers = [[_number(p) for p in side] for side in (left, right)]
    counts = f"{len(left)} left and {len(right)} right"
    of_left, of_right = map(set, numbers)
    alone = of_left ^ of_right
    if all(len(set(n)) == len(n) for n in numbers) and alone and of_left & of_right:
        every = list(of_left | of_right)
        if not all(n.isdecimal() for n in every) or 2 * len(alone) > len(every):  # they are not frame numbers
            first = next(p for p in (*left, *right) if _number(p) in alone)
            problem = f"{len(alone)} of {counts} images have no partner of the same number"
            raise LogError(f"{problem}, the first: {first}; leave them out")
        place = {number: n for n, number in enumerate(sorted(every, key=int))}
        return [[place[n] for n in side] for side in numbers], len(every)
    if len(left) != len(right):
        raise LogError(f"{counts} images are paired in the order of their names: give as many of both")
    return [list(range(len(left)))] * 2, len(left)


def _number(path: Path) -> str:
    """Return the last number in the name of a file, or else the name."""
    numbers = re.findall(r"\d+", path.stem)
    return str(int(numbers[-1])) if numbers else path.stem


@record
class ImageSides:
    """Folders or files of the left and right images; `others`: further pairs, which are not used."""

    left: str | Sequence[str]
    right: str | Sequence[str]
    others: Sequence[str] = ()


def image_sides(folder: Path) -> ImageSides | None:
    """Return the sides in a folder: two folders with images in them or one level below, else files; None: no pair.

    Of several pairs of folders, the one with the most images is taken: TUM-VI also has a pair of vignettes.
    """
    names = [entry.name for entry in _folders(folder) if is_camera(entry.name)]
    pairs = possible_pairs(names)
    if not pairs and set(_OF_KITTI) <= set(names):
        pairs = [_OF_KITTI]
    counts = {
        (f"{left}{inner}", f"{right}{inner}"): count
        for left, right in pairs
        for inner in _common(folder / left, folder / right)
        if (count := min(len(images_in(folder / f"{side}{inner}")) for side in (left, right)))
    }
    if counts:
        best = max(counts, key=lambda pair: counts[pair])  # the first of several equal ones
        others = [f"{left} and {right}" for left, right in counts if 2 * counts[left, right] > counts[best]]
        others.remove(" and ".join(best))
        return ImageSides(str(folder / best[0]), str(folder / best[1]), others)
    return _files(folder)


def image_folders(folder: Path, deep: int = 3) -> Iterator[tuple[Path, int]]:
    """Yield the folders with images in and below a folder, with how many they hold."""
    if count := len(images_in(folder)):
        yield folder, count
    for entry in _folders(folder) if deep else ():
        yield from image_folders(Path(entry.path), deep - 1)


def _folders(folder: Path) -> list["os.DirEntry[str]"]:
    with os.scandir(folder) as entries:
        found = sorted((e for e in entries if e.is_dir() and not e.name.startswith(".")), key=lambda e: e.name)
    return found[:_MOST_FOLDERS]


def _common(left: Path, right: Path) -> list[str]:
    """Return the places for images that both folders have: themselves, and subfolders of the same name."""
    return ["", *(f"/{e.name}" for e in _folders(left) if (right / e.name).is_dir())]


def _files(folder: Path) -> ImageSides | None:
    """Return pairs of files whose names differ in the side only, such as left_0001.png and right_0001.png."""
    images = [path for path in images_in(folder) if is_camera(path.name)]
    for rule in range(RULES):
        left, right = (
            {key: path for path in images if (key := side_keys(path.name, side).get(rule)) is not None}
            for side in (0, 1)
        )
        both = sorted(left.keys() & right.keys())
        if both and 3 * len(both) > len(images):  # otherwise a few names match by chance
            return ImageSides([str(left[key]) for key in both], [str(right[key]) for key in both])
    return None
