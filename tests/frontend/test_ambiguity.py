"""An ambiguity is remembered after its views have gone, until new points confirm the motion followed."""

import numpy as np

from stream_sfm.frontend.second_motions.ambiguity import AmbiguityMemory
from stream_sfm.frontend.tracks import Tracks
from stream_sfm.geometry import se3
from stream_sfm.geometry.resection import Resection, SecondMotion
from stream_sfm.record import changed

FIRST = se3.exp([0.01, 0, 0.02, 0, 0.01, 0])
OTHER_FROM_FIRST = se3.exp([0.05, 0.01, 0, 0, 0, 0.02])


TRACKS = changed(Tracks.none(), ids=np.arange(40), agreed=np.zeros(40, np.int64))
LATER = np.arange(40) >= 20  # the views of the other set, if there is one


def motion(cam_from_ref: np.ndarray, odds: float | None, views: np.ndarray = ~LATER & LATER) -> Resection:
    """A resection of forty views, with a second motion of given `odds` and `views`, or without one."""
    second = None
    if odds is not None:
        second = SecondMotion(OTHER_FROM_FIRST @ cam_from_ref, np.eye(6), views, odds)
    return Resection(cam_from_ref, np.eye(6), ~views, 0.0, 34, 1.0, True, np.zeros(40), 1.0, second=second)


def others(motions: list[Resection], new_per_frame: int = 0) -> list[np.ndarray | None]:
    """The other motion of each frame, or None; so many of the first tracks are exchanged for new ones per frame."""
    memory, found, tracks = AmbiguityMemory(), [], TRACKS
    for frame in motions:
        memory, other, _ = memory.after(frame, tracks)
        found.append(None if other is None else other.cam_from_ref)
        tracks = changed(tracks, ids=tracks.ids + new_per_frame)
    return found


def test_an_ambiguity_outlives_its_views_with_the_same_difference() -> None:
    turned = FIRST @ se3.exp([0, 0, 0, 0, 0.1, 0])
    small = motion(FIRST, 0.01)  # a body without history
    none, of_body, own, *remembered = others(
        [motion(FIRST, None), small, motion(FIRST, 0.5), *[motion(turned, None)] * 40]
    )
    assert none is None and of_body is None
    assert own is not None and np.array_equal(own, OTHER_FROM_FIRST @ FIRST)
    assert all(other is not None and np.allclose(other, OTHER_FROM_FIRST @ turned, atol=1e-12) for other in remembered)


def test_new_points_end_an_ambiguity_and_a_new_one_begins_without_memory() -> None:
    clear, ambiguous = motion(FIRST, None), motion(FIRST, 0.5)
    found = [other is not None for other in others([ambiguous] * 25 + [clear] * 15 + [ambiguous] + [clear] * 15, 20)]
    first, second = found[25:40].index(False), found[41:].index(False)
    assert all(found[: 25 + first]) and not any(found[25 + first : 40]) and found[40]
    assert first == second and 1 <= first <= 5  # however long it has lasted


def test_an_ambiguity_that_new_points_contradict_lasts() -> None:
    clear = changed(motion(FIRST, None), accepted=np.arange(40) < 30)  # half of the new ones disagree
    assert all(other is not None for other in others([motion(FIRST, 0.5), *[clear] * 60], 20))


def test_what_shows_that_a_view_does_not_repeat_settles_the_path_at_once() -> None:
    """All points agree with either motion as long as it repeats. There is one set of them: none has to be confirmed."""
    memory, tracks, told = AmbiguityMemory(), TRACKS, []
    alike = SecondMotion(OTHER_FROM_FIRST @ FIRST, np.eye(6), ~LATER & LATER, 1.0)
    for k in range(8):
        memory, other, settled = memory.after(motion(FIRST, None), tracks, alike if k < 4 else None)
        told.append((other is not None, memory.repeats, settled))
        tracks = changed(tracks, ids=tracks.ids + 20)
    assert told == [*[(True, True, False)] * 4, (False, False, True), *[(False, False, False)] * 3]


def test_two_sets_in_the_frame_in_which_a_view_ceases_to_repeat_stay_ambiguous() -> None:
    alike = SecondMotion(OTHER_FROM_FIRST @ FIRST, np.eye(6), ~LATER & LATER, 1.0)
    memory, _, _ = AmbiguityMemory().after(motion(FIRST, None), TRACKS, alike)
    memory, other, settled = memory.after(motion(FIRST, 0.5), TRACKS)
    assert memory.lasts and not memory.repeats and other is not None and not settled
