"""New points confirm a motion or refute it: each counts once, and those of one frame count as one event."""

import numpy as np
import pytest

from stream_sfm.frontend.rules import MotionRules
from stream_sfm.frontend.second_motions.confirmation import Confirmation

RULES = MotionRules()


def after(shares: list[float], new: int = 20) -> list[Confirmation]:
    """The confirmation after each frame with so many new points, of which a share agrees."""
    found, confirmation, ids = [], Confirmation.sought(RULES), np.arange(0)
    for share in shares:
        ids = np.arange(len(ids) + new)
        confirmation = confirmation.after(ids, np.arange(len(ids)) < len(ids) - round((1 - share) * new))
        found.append(confirmation)
    return found


def test_points_that_agree_frame_after_frame_confirm_a_motion() -> None:
    there = [c.is_there for c in after([0.95] * 20)]
    begun = there.index(True)
    assert 1 <= begun <= 5 and all(there[begun:])  # not the first frame alone, and not more than half a second
    assert not any(c.contradicted for c in after([0.95] * 20))


@pytest.mark.parametrize("share", [0.5, 0.65, 0.75])
def test_a_body_is_not_confirmed_and_contradicted_at_once(share: float) -> None:
    found = after([share] * 60)
    assert all(c.contradicted for c in found) and not any(c.is_there for c in found)


def test_contrary_evidence_takes_back_what_there_was() -> None:
    good, bad = after([1.0]), after([1.0, 0.75])
    assert 0 < bad[-1].evidence.change < good[-1].evidence.change and not bad[-1].contradicted
    assert after([1.0, 0.3])[-1].contradicted


def test_each_point_counts_once_and_those_before_the_ambiguity_never() -> None:
    ids = np.arange(30)
    confirmation = Confirmation.sought(RULES, next_id=30).after(ids, ids < 0)
    assert confirmation.evidence.change == 0 and not confirmation.contradicted
    ids = np.arange(40)
    once = confirmation.after(ids, ids >= 0)
    assert once.evidence.change > 0.3
    assert once.after(ids, ids >= 0).evidence.change < once.evidence.change  # only forgetting
