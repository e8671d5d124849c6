"""A start is taken for good, or redone, by what points say that begin after it."""

import numpy as np

from stream_sfm.frontend.start_check import StartCheck
from stream_sfm.frontend.tracks import FULL_HISTORY


def after(check: StartCheck, frames: int, agree: float) -> StartCheck:
    """The check after frames that find twenty new tracks each, of which that share agrees."""
    for _ in range(frames):
        ids = check.next_id + np.arange(20)
        check = check.after(ids, np.arange(20) < 20 * agree)
    return check


def test_a_calm_start_is_taken_for_good() -> None:
    check = after(StartCheck(), FULL_HISTORY, 0.95)
    assert check.is_over and not check.doubted
    assert after(check, 5, 0.0) is check  # bodies that come later have the history against them


def test_new_points_that_disagree_are_doubts_until_the_next_ones_have_agreed_for_long() -> None:
    doubted = after(after(StartCheck(), 3, 1.0), 8, 0.3)
    assert "of the points that have begun lately" in doubted.problem
    calm = after(doubted, FULL_HISTORY, 1.0)
    assert not calm.is_over and calm.problem
    over = after(calm, 2 * FULL_HISTORY, 1.0)
    assert over.is_over and over.doubted and not over.problem


def test_a_track_is_judged_once() -> None:
    check = StartCheck().after(np.arange(20), np.arange(20) < 17)
    again = check.after(np.arange(17, 20), np.zeros(3, bool))
    assert not again.doubted
