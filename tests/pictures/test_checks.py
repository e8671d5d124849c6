"""When checks of pictures look, and when a suspicion begins and ends."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from stream_sfm.config.rules import Rules
from stream_sfm.geometry.evidence import Evidence
from stream_sfm.pictures.checks import Suspicion, Suspicions, checks
from stream_sfm.pictures.prepared import PreparedImages
from stream_sfm.pictures.view import View

IMAGES = PreparedImages.of(np.zeros((40, 50), np.uint8), np.zeros((40, 50), np.uint8), 0)
FIRST, EVERY, BOUND = 5, 10, 12.0


class Told:
    """A check that says what it is told, and notes the frames in which it looks and the views that it gets."""

    sentence: ClassVar[str] = "the images are bad"
    of_pair: ClassVar[bool] = False
    earlier = 2

    def __init__(self, says: list[float | None]) -> None:
        self.says, self.views = says, dict[int, int]()

    def nats(self, images: PreparedImages, views: tuple[View, ...]) -> float | None:
        frame = int(views[-1].ids[0])
        self.views[frame] = len(views)
        return self.says[frame]


def run(check: Told) -> list[str]:
    """The problems after each frame."""
    state = Suspicions((Suspicion(check, Evidence(BOUND, 1e9)),), (), FIRST, EVERY)
    problems = []
    for frame in range(len(check.says)):
        state = state.after(IMAGES, np.array([frame]), np.zeros((1, 2)))
        problems.append(state.problem)
    return problems


def test_the_first_telling_frames_are_examined_and_then_every_tenth() -> None:
    check = Told([None, None, *[-1.0] * 40])
    assert not any(run(check))
    assert list(check.views) == [*range(7), 16, 26, 36]
    assert [check.views[frame] for frame in (0, 1, 6, 16, 36)] == [1, 2, 3, 3, 3]  # with the views that it needs


def test_a_suspicion_begins_and_ends_by_the_same_evidence_and_is_watched_meanwhile() -> None:
    """Frames that say nothing, however many, change nothing."""
    check = Told([*[5.0] * 4, *[None] * 50, *[-5.0] * 5])
    assert [bool(p) for p in run(check)] == [*[False] * 2, *[True] * 54, *[False] * 3]


def test_a_fault_that_begins_late_is_seen_by_a_rare_look_and_then_in_each_frame() -> None:
    check = Told([*[-1.0] * 12, *[5.0] * 20])
    problems = run(check)
    assert list(check.views)[5:8] == [14, 15, 16] and problems.index("the images are bad") == 16


def test_without_what_is_followed_nothing_is_compared() -> None:
    state = Suspicions((Suspicion(Told([-1.0] * 9), Evidence(BOUND, 1e9)),), (), FIRST, EVERY)
    for frame in range(3):
        state = state.after(IMAGES, np.array([frame]), np.zeros((1, 2)))
    assert len(state.views) == 3 and not state.interrupted().views


def test_all_checks_say_what_is_wrong_and_what_to_do() -> None:
    named = [check.sentence for check in checks(Rules())]
    assert len(set(named)) == len(named) and all("?" in sentence for sentence in named)
    found = Suspicions.begun(Rules())
    for n, check in enumerate(checks(Rules())):
        there = replace(found.each[n], evidence=replace(found.each[n].evidence, is_there=True))
        state = replace(found, each=(*found.each[:n], there, *found.each[n + 1 :]))
        assert state.problem == check.sentence and state.problem_of_pair == check.sentence * check.of_pair
