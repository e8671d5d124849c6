"""Finds the left and the right images in a folder, by what its folders or files are called."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..record import record
from .image_sets import images_in
from .sides import RULES, is_camera, possible_pairs, side_keys

_OF_KITTI = ("image_2", "image_3")  # the colour cameras, which the rules of names do not pair
_MOST_FOLDERS = 200  # in one folder that are looked into


@record
class ImageSides:
    """Folder, or files, of the left and the right images; `others`: further pairs, which are not used."""

    left: str | Sequence[str]
    right: str | Sequence[str]
    others: Sequence[str] = ()


def image_sides(folder: Path) -> ImageSides | None:
    """Return the sides in a folder: two folders with images in or one folder below them, else files; None: no pair.

    Of several pairs of folders the one with the most images is taken: TUM-VI has one of vignettes, too.
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
        best = max(counts, key=lambda pair: counts[pair])  # the first one of several that are equal
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
    """The places that both folders have for images: in themselves, and in folders of one name."""
    return ["", *(f"/{e.name}" for e in _folders(left) if (right / e.name).is_dir())]


def _files(folder: Path) -> ImageSides | None:
    """Pairs of files whose names differ in the side only, such as left_0001.png and right_0001.png."""
    images = [path for path in images_in(folder) if is_camera(path.name)]
    for rule in range(RULES):
        left, right = (
            {key: path for path in images if (key := side_keys(path.name, side).get(rule)) is not None}
            for side in (0, 1)
        )
        both = sorted(left.keys() & right.keys())
        if both and 3 * len(both) > len(images):  # else of few files the names are like that by chance
            return ImageSides([str(left[key]) for key in both], [str(right[key]) for key in both])
    return None
