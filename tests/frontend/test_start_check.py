"""Points that begin after the start of a map and move differently count if they may be a scene that a body hides."""

import numpy as np
import pytest

from stream_sfm.config.rules import Rules
from stream_sfm.frontend.second_motions.motion_choice import may_be_scene
from stream_sfm.frontend.second_motions.start_check import StartCheck
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
