"""Chooses the topics of the left and the right camera, and the calibration that belongs to each.

The choice is by schema first, then by name (sources/sides.py). Among several forms of one camera pair, the order of
preference is: rectified before raw images (the vendor's rectification fits the images even if R and D are missing),
grey before colour, uncompressed before compressed. Anything else is the user's choice.
"""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from ...errors import LogError
from ...record import record
from ...system.wording import some_of
from ..sources.sides import is_camera, possible_pairs, side_keys

_FORM = re.compile(r"(?<![a-z])(compressed|rect|rectified|raw|colou?r|mono|gr[ae]y|rgb|image)(?![a-z])")
_RECTIFIED = re.compile(r"(?<![a-z])rect(ified)?(?![a-z])")
_COLOUR = re.compile(r"(?<![a-z])(colou?r|rgb)(?![a-z])")


@record
class PairChoice:
    """The topics chosen for the two cameras, and the reason."""

    left: str
    right: str
    reason: str


def is_rectified(topic: str) -> bool:
    """Whether the name says, in the manner of ROS, that the images are rectified (`image_rect`, `rect_color` …)."""
    return _RECTIFIED.search(topic) is not None


def choose_pair(
    path: Path, image_topics: Mapping[str, int | None], left: str | None = None, right: str | None = None
) -> PairChoice:
    """Choose the pair among `image_topics` (topic -> number of messages, None unknown).

    Raises a LogError with the candidates if there is none, or if the user has to choose.
    """
    left, right = (None if topic is None else _transport(topic, image_topics) for topic in (left, right))
    _check_named(path, image_topics, left, right)
    if left is not None and right is not None:
        return PairChoice(left, right, "named by the user")
    cameras = _cameras(image_topics)
    if not cameras:
        empty = sorted(filter(is_camera, image_topics))
        more = f" (without any message: {', '.join(empty)})" if empty else ""
        raise LogError(f"{path} holds no camera images{more}; image topics are: {_listed(image_topics)}")
    pairs = possible_pairs(cameras)
    if (named := left or right) is not None:
        pairs = [pair for pair in pairs if named in pair]
        others = [t for t in cameras if t != named]
        if not pairs and len(others) == 1:
            pair = (named, others[0]) if left else (others[0], named)
            return PairChoice(*pair, "one topic named by the user, the other is the only one left")
        if pairs and named != pairs[0][0 if left else 1]:
            pairs = [pairs[0][::-1]]
    if not pairs:
        raise _no_pair(path, cameras, image_topics)
    if len(pairs) == 1:
        return PairChoice(*pairs[0], "their names differ only in the side")
    if len({tuple(_words(_FORM.sub("", l))) for l, _ in pairs}) == 1:  # one camera pair in several forms
        best = min(pairs, key=lambda p: (*_form_rank(p[0]), p))
        return PairChoice(*best, "of the forms of one pair: rectified before raw, grey before colour")
    candidates = some_of([f"{l} and {r}" for l, r in pairs], "; ")
    raise LogError(f"{path} holds several stereo pairs, name one: {candidates}", hint=("left", "right"))


def choose_one(path: Path, image_topics: Mapping[str, int | None], left: str | None = None) -> PairChoice:
    """Choose one camera, as a pair of the same topic twice. Raises LogError as `choose_pair`.

    It is the one named, the only one, or the left one of the pair that `choose_pair` would choose.
    """
    cameras = _cameras(image_topics)
    if left is not None and (left := _transport(left, image_topics)) in image_topics:
        return PairChoice(left, left, "named by the user")
    if len(cameras) == 1 and left is None:
        return PairChoice(cameras[0], cameras[0], "the only camera")
    pair = choose_pair(path, image_topics, left)
    return PairChoice(pair.left, pair.left, f"left of a pair: {pair.reason}")


def _cameras(image_topics: Mapping[str, int | None]) -> list[str]:
    """Return the topics of cameras that have sent messages."""
    return [t for t, count in image_topics.items() if is_camera(t) and count != 0]


def _no_pair(path: Path, cameras: list[str], image_topics: Iterable[str]) -> LogError:
    if len(cameras) == 1:
        return LogError(
            f"{path} holds images of one camera only, {cameras[0]}: if each image holds both sides, give the "
            "calibration of one side; else replay it as one camera, without scale; image topics are: "
            f"{_listed(image_topics)}",
            hint=("calibration", "mono"),
        )
    problem = f"{path}: topic names do not show which is the left and which the right camera; name both"
    return LogError(f"{problem}; image topics are: {_listed(cameras)}", hint=("left", "right"))


def _transport(topic: str, image_topics: Iterable[str]) -> str:
    """Return the topic that carries the images of `topic`: itself, or its compressed form if only that exists."""
    compressed = f"{topic.rstrip('/')}/compressed"
    return compressed if topic not in image_topics and compressed in image_topics else topic


def _check_named(path: Path, image_topics: Iterable[str], left: str | None, right: str | None) -> None:
    for side, topic in (("left", left), ("right", right)):
        if topic is not None and topic not in image_topics:
            known = f"image topics are: {_listed(image_topics)}"
            raise LogError(f"{path}: {topic} is not an image topic of this log; {known}", hint=(side,))
    if left is not None and left == right:
        raise LogError(f"{path}: left and right are both {left}: name two topics", hint=("left", "right"))


def _listed(topics: Iterable[str]) -> str:
    return some_of(sorted(topics)) or "none"


def _form_rank(topic: str) -> tuple[bool, bool, bool]:
    return not is_rectified(topic), _COLOUR.search(topic) is not None, topic.endswith("/compressed")


def choose_calibration(image_topic: str, side: int, calibration_topics: Iterable[str]) -> str | None:
    """Return the calibration topic of an image topic: of the same side, with the closest name, or None."""
    sided = set(side_keys(image_topic, side))
    image_words = _words(image_topic)
    ranked = []
    for topic in calibration_topics:
        if sided and not sided & set(side_keys(topic, side)):
            continue  # the other camera's, or a third one's
        words = _words(topic)
        shared = len(set(image_words) & set(words))
        common = next((i for i, (a, b) in enumerate(zip(image_words, words, strict=False)) if a != b), len(words))
        if sided or shared:
            ranked.append((-shared, -common, len(words), topic))
    return min(ranked)[-1] if ranked else None


def _words(topic: str) -> list[str]:
    return [w for w in re.split(r"[/_]+", topic) if w]
