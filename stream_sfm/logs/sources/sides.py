"""Which of two names of topics, folders or files is the left and which the right one.

Two names make a pair if they differ in the side only: left/right, l/r, cam0/cam1, infra1/infra2 and the like.
"""

import re
from collections.abc import Iterable

_NOT_A_CAMERA = re.compile(
    r"depth(?!ai)|disparity|mask|segment|semantic|confidence|label|normals|overlay|debug|heatmap", re.IGNORECASE
)
# words that may precede 0/1 or 1/2 in the names of two cameras
_NUMBERED = r"((?i:cam(?:era)?|infra(?:red)?|ir|image|img|mono|gr[ae]y|stereo|fisheye|sensor|eye))([_-]?0*)"
_SIDES: tuple[tuple[re.Pattern[str], re.Pattern[str]], ...] = tuple(
    (re.compile(left), re.compile(right))
    for left, right in (
        (r"[Ll]eft|LEFT", r"[Rr]ight|RIGHT"),
        (r"(?<![A-Za-z])[lL](?![A-Za-z])", r"(?<![A-Za-z])[rR](?![A-Za-z])"),
        (rf"{_NUMBERED}0(?!\d)", rf"{_NUMBERED}1(?!\d)"),
        (rf"{_NUMBERED}1(?!\d)", rf"{_NUMBERED}2(?!\d)"),
        (r"(?<=[a-z])L(?![A-Za-z])", r"(?<=[a-z])R(?![A-Za-z])"),
    )
)  # fmt: skip
RULES = len(_SIDES)


def is_camera(name: str) -> bool:
    """Whether the images come from a camera: depth, disparity, masks and drawings are also image messages."""
    return _NOT_A_CAMERA.search(name) is None


def side_keys(name: str, side: int) -> dict[int, str]:
    """Return rule number -> the name with its side (0 left, 1 right) replaced by `*`, for each matching rule."""
    keys = {}
    for rule, patterns in enumerate(_SIDES):
        key, found = patterns[side].subn(lambda m: f"{m.group(1) if m.re.groups else ''}*", name)
        if found:
            keys[rule] = key
    return keys


def possible_pairs(names: Iterable[str]) -> list[tuple[str, str]]:
    """Return all (left, right) among `names` that differ in the side only, by the clearest rule first."""
    names = sorted(names)
    pairs: list[tuple[str, str]] = []
    paired: set[str] = set()
    for rule in range(RULES):
        rights = {key: t for t in names if (key := side_keys(t, 1).get(rule)) is not None}
        for name in names:
            right = rights.get(side_keys(name, 0).get(rule, ""))
            # cam1 of a pair (cam0, cam1) is not the left one of (cam1, cam2)
            if right is not None and right != name and not {name, right} & paired:
                pairs.append((name, right))
                paired |= {name, right}
    return pairs
