"""Points that begin after the start of a map and move differently count if they may be a scene that a body hides."""

import numpy as np
import pytest

from stream_sfm.config.rules import Rules
from stream_sfm.frontend.rules import MotionRules
from stream_sfm.frontend.second_motions.confirmation import Confirmation
from stream_sfm.frontend.second_motions.motion_choice import may_be_scene
from stream_sfm.frontend.second_motions.start_check import StartCheck
from stream_sfm.geometry.evidence import Evidence
from stream_sfm.record import changed
from tests.helpers.tracks import tracks_at

N_FOLLOWED, N_OTHERS = 40, 8


@pytest.mark.parametrize(
    ("followed_m", "others_m", "fills_view", "counts"),
    [
        (3.0, 3.0, True, False),  # a body that passes close to a wall, which filled the view
        (3.0, 3.0, False, True),  # with two motions from the start, this is unknown
        (1.0, 3.0, True, True),  # a body that filled the view, and the room behind it
        (3.0, 1.0, False, False),  # in front of its neighbours: a body
    ],
)
def test_others_count_unless_they_cannot_be_the_scene(
    followed_m: float, others_m: float, fills_view: bool, counts: bool
) -> None:
    depth_m = np.repeat([followed_m, others_m], [N_FOLLOWED, N_OTHERS])
    accepted = np.arange(len(depth_m)) < N_FOLLOWED
    others = may_be_scene(Rules(), tracks_at(depth_m), accepted, fills_view)
    assert not others[accepted].any()
    assert (others[~accepted] == counts).all()


def test_if_all_points_agree_none_counts_against_the_start() -> None:
    assert not may_be_scene(Rules(), tracks_at(np.full(9, 2.0)), np.ones(9, bool), True).any()


def test_only_the_first_frame_decides_whether_one_motion_filled_the_view() -> None:
    assert not StartCheck().fills_view
    full, crowd = StartCheck().begun_with(0.95), StartCheck().begun_with(0.6)
    assert full.begun_with(0.1).fills_view
    assert not crowd.begun_with(1.0).fills_view


def test_a_start_is_in_doubt_while_points_may_be_followed_body() -> None:
    """New points that agree do not end that, as far ones agree with either motion."""
    body, ids = Evidence(21.0, 30.0), np.arange(40)
    start = changed(StartCheck(), body=body.after(10.0)).after(ids, ids >= 0)
    assert start.suspects and start.contradicted and start.problem and not start.is_over
    more = np.arange(80)
    start = start.after(more, more >= 0)
    assert start.confirmation.is_there and not start.is_over and start.problem
    calm = changed(start, body=body)
    assert calm.is_over and not calm.problem and calm.contradicted  # what covered it stays


def test_a_start_that_has_followed_a_body_is_confirmed_by_points_that_begin_later() -> None:
    ids = np.arange(40)
    followed = changed(
        StartCheck(), body=Evidence(21.0, 30.0).after(22.0), confirmation=Confirmation.sought(MotionRules(), 40)
    )
    assert followed.followed_body and not followed.suspects
    old = followed.after(ids, ids >= 0)
    assert old.problem and not old.is_over
    assert old.after(ids + 40, ids >= 0).after(ids + 80, ids >= 0).is_over
